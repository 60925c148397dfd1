// Matches the images of a recording without playing it. Uses all cores, drops no image, and gives
// the same messages as the nodelet.

#include <cv_bridge/cv_bridge.h>
#include <ktgp_orb/MatchStatus.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <deque>
#include <filesystem>
#include <iostream>
#include <map>
#include <opencv2/core/utility.hpp>
#include <regex>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

#include "bag/reader.h"
#include "bag/video.h"
#include "files/input.h"
#include "files/output_file.h"
#include "files/tiff_pages.h"
#include "ktgp_orb/metrics.h"
#include "ktgp_orb/status.h"
#include "matching/standing/standing.h"
#include "ros/camera.h"
#include "ros/image_conversion.h"
#include "ros/message_matcher.h"
#include "ros/rate_limiter.h"
#include "ros/stamps.h"
#include "tools/bag_motion.h"
#include "tools/bag_pipeline.h"
#include "tools/bag_targets.h"
#include "tools/bag_views.h"
#include "tools/bag_writer.h"
#include "tools/matcher_cli.h"
#include "tools/program.h"
#include "tools/video_file.h"
#include "util/counted.h"
#include "util/format.h"
#include "util/printable.h"

namespace ktgp_orb::tools {
namespace {

struct Arguments {
  std::string in;
  std::string out;
  BagSelection selection;
  std::string name;
  std::string csv;
  bool overlay = false;
  std::string draw;
  double rate = 0.0;     ///< images per second; 0: use the times of the recording
  int longest_side = 0;  ///< longer side to which images of a pattern are shrunk, px; 0: never
  ViewOptions views;
  MotionFile motion;
  TargetsInput targets;
  std::vector<double> camera;  ///< fx, fy, cx, cy, px; empty: use the bag's camera_info
  bool force = false;
  bool skip_finished = false;
  Parameters parameters;
};

std::unique_ptr<ImageSource> openInput(const Arguments& arguments) {
  constexpr double kUsualRate = 30.0;
  const InputKind kind = kindOf(arguments.in);
  if (kind == InputKind::images) {
    return openImages(arguments.in, arguments.selection,
                      arguments.rate > 0.0 ? arguments.rate : kUsualRate, arguments.longest_side);
  }
  std::error_code none;
  if (std::filesystem::is_directory(arguments.in, none)) {
    throw files::FileError(arguments.in, files::unreadableFormat(arguments.in));
  }
  files::requireRegularFile(arguments.in);
  if (kind == InputKind::video) {
    return openVideo(arguments.in, arguments.selection, arguments.rate);
  }
  if (arguments.rate > 0.0) {
    throw std::invalid_argument(
        "--rate has no effect: a bag has the times of its images; leave it out");
  }
  return openBag(arguments.in, arguments.selection);
}

/// Makes the K of photographs that of the smaller images of --longest_side. The middle of the first
/// pixel has the coordinates 0, 0, so its corner is at -0.5.
void scaleK(double x, double y, sensor_msgs::CameraInfo::_K_type& k) {
  k[0] *= x;
  k[2] = (k[2] + 0.5) * x - 0.5;
  k[4] *= y;
  k[5] = (k[5] + 0.5) * y - 0.5;
}

/// The camera_info made from --camera and the size of the first usable image; empty without the
/// option.
std::optional<sensor_msgs::CameraInfo> givenCamera(const Arguments& arguments) {
  const auto camera = cameraFrom(arguments.camera);
  if (!camera) return std::nullopt;
  sensor_msgs::CameraInfo info;
  const auto images = openInput(arguments);
  auto first = images->next();
  while (first && (!first->image || sizeOf(*first->image).empty())) first = images->next();
  if (!first) return std::nullopt;  // no image can be used; run() will report it
  info.width = first->image->width;
  info.height = first->image->height;
  info.distortion_model = "plumb_bob";
  for (int i = 0; i < 9; ++i) info.K[static_cast<std::size_t>(i)] = (*camera)(i / 3, i % 3);
  scaleK(first->x_scale, first->y_scale, info.K);
  // Throws if K is impossible.
  lensFrom(info);
  return info;
}

/// Namespace of the output topics: `name` or, if `name` is empty, `nodelet` in the namespace of the
/// camera, as when the nodelet runs.
std::string outputNames(const std::string& name, const std::string& topic, const char* nodelet) {
  return name.empty() ? cameraOf(topic) + "/" + nodelet : name;
}

/// The usual rate of the first images of a bag, 1/s; 0 if their stamps do not tell.
double rateOfBag(const Arguments& arguments) {
  constexpr int kImages = 30;
  const auto images = openInput(arguments);
  std::vector<double> steps;
  ros::Time last;
  for (int i = 0; i < kImages; ++i) {
    const auto recorded = images->next();
    if (!recorded) break;
    if (!recorded->image) continue;
    const ros::Time stamp = recorded->image->header.stamp;
    if (!last.isZero() && stamp > last) steps.push_back((stamp - last).toSec());
    last = stamp;
  }
  if (steps.empty()) return 0.0;
  const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
  std::nth_element(steps.begin(), middle, steps.end());
  // MPEG-4 stores a rate as a ratio of two 16-bit numbers, so two decimals must be enough.
  return std::clamp(std::round(100.0 / *middle) / 100.0, 1.0, 240.0);
}

/// Images per second in the written videos.
double pictureRate(const Arguments& arguments) {
  double rate = arguments.rate;
  const InputKind kind = kindOf(arguments.in);
  if (rate == 0.0 && kind == InputKind::video) rate = rateOfVideo(arguments.in);
  if (rate == 0.0 && kind == InputKind::bag) rate = rateOfBag(arguments);
  if (rate == 0.0) rate = arguments.views.rate;
  const double most = arguments.parameters.max_rate;  // images above this rate are skipped
  return most > 0.0 ? std::min(rate, most) : rate;
}

void sayNoMotion(const std::string& problem) {
  std::fprintf(stderr, "ktgp_bag: no motion of the camera, only the geometry: %s\n",
               problem.c_str());
}

/// Processes the recording. `pipeline_` extracts the features of several images in parallel, and
/// matches them there if it can. This class does everything else, one frame after the other.
class Run {
 public:
  Run(const Arguments& arguments, std::unique_ptr<ImageSource> source,
      const Configuration& configuration, const std::optional<sensor_msgs::CameraInfo>& camera,
      int threads)
      : outputs_(arguments.force),
        source_(std::move(source)),
        matcher_(configuration),
        pipeline_(configuration,
                  configuration.sequence.reference.mode == ReferenceMode::fixed
                      ? matcher_.fixedReference()
                      : nullptr,
                  threads),
        writer_(arguments.out, arguments.csv,
                outputNames(arguments.name, source_->topic(), "matcher"), outputs_),
        views_(
            arguments.views, [&arguments] { return openInput(arguments); }, outputs_,
            camera || arguments.views.mosaic.empty() ? camera
                                                     : cameraInfoOf(arguments.in, source_->topic()),
            pixelsFrom(arguments.parameters.calibration, source_->topic())),
        motion_(arguments.motion, arguments.in, source_->topic(), camera),
        targets_(arguments.targets, arguments.in, source_->topic(), camera),
        detections_topic_(outputNames(arguments.name, source_->topic(), "targets") + "/detections"),
        progress_(source_->total()),
        view_(configuration.view),
        finds_motions_(configuration.sequence.matcher.geometry != GeometryModel::homography),
        is_fixed_(configuration.sequence.reference.mode == ReferenceMode::fixed),
        growth_is_idle_(configuration.sequence.matcher.growth.enabled &&
                        configuration.sequence.reference.mode == ReferenceMode::previous),
        draws_overlay_(arguments.overlay),
        discards_interrupted_(arguments.skip_finished),
        max_age_(configuration.sequence.reference.max_age) {
    if (!arguments.draw.empty()) {
      drawing_.emplace(arguments.draw, pictureRate(arguments), outputs_);
    }
    rate_limiter_.setRate(configuration.max_rate);
  }

  int run() {
    while (!tools::interrupted()) {
      auto recorded = source_->next();
      if (!recorded) break;
      if (recorded->image && !rate_limiter_.takes(recorded->image->header.stamp)) {
        ++skipped_;
        progress_.advance("images");
        continue;
      }
      if (recorded->image) pipeline_.push(recorded->image);
      waiting_.push_back({std::move(*recorded), skipped_});
      if (pipeline_.full()) finishOldest();
    }
    while (!waiting_.empty()) finishOldest();
    if (tools::interrupted() && discards_interrupted_) return tools::kExitInterrupted;
    // Write nothing: with OUT.bag, --skip_finished would take the recording for one that is done.
    if (!tools::interrupted() && matched_ == 0) return tools::kExitUnusable;
    views_.close();
    motion_.close(outputs_);
    if (drawing_ && !drawing_->empty()) drawing_->close();
    // Do this last: users take OUT.bag as the sign that all files are complete.
    const std::string unused = unusedPart();
    writer_.close(unused);
    outputs_.commit();
    if (tools::interrupted()) return tools::kExitInterrupted;
    return unused.empty() ? tools::kExitDone : tools::kExitUnusedData;
  }

  /// Prints how many images were matched, refused and skipped, why the first refused image was
  /// refused, and any damage of the input. `code`: the result of run().
  void report(const Arguments& arguments, int code) const {
    std::cerr << (code == tools::kExitInterrupted ? "interrupted: " : "")
              << util::counted(matched_, "image") << " of " << source_->topic() << " matched, "
              << refused_ << " refused, " << skipped_ << " skipped by max_rate; ";
    if (code == tools::kExitUnusable) {
      std::cerr << "no file is written\n" << views_.report();
    } else {
      std::cerr << "results in " << arguments.out << '\n'
                << summary() << views_.report() << motion_.report() << targets_.report();
    }
    if (!source_->note().empty()) std::cerr << "ktgp_bag: " << source_->note() << '\n';
    if (refused_ > 0) std::cerr << "ktgp_bag: " << arguments.in << ": " << refusals() << '\n';
    if (source_->damage().empty()) return;
    const bool is_bag = kindOf(arguments.in) == InputKind::bag;
    std::cerr << "ktgp_bag: " << arguments.in << ": " << source_->damage()
              << (matched_ > 0 ? "\nWhat could be read is matched" : "")
              << (is_bag ? "; 'rosbag reindex' may repair it.\n" : ".\n");
  }

 private:
  std::string refusals() const {
    return util::counted(refused_, "image") + " could not be used" +
           (refused_ > 1 ? ", the first" : "") + " because: " + refusal_;
  }

  /// Says which part of the recording is not in the results; empty if all of it is.
  std::string unusedPart() const {
    std::vector<std::string> parts;
    if (tools::interrupted()) parts.emplace_back("the run was interrupted");
    if (refused_ > 0) parts.push_back(refusals());
    if (!source_->damage().empty()) parts.push_back(source_->damage());
    if (motion_.foundNone()) parts.emplace_back("no frame has a motion");
    return util::joined(parts, "; ");
  }

  /// Says what was found, for example "19 motions (19 epipolar), median parallax 0.9 degrees".
  std::string successes(std::size_t found) const {
    if (!finds_motions_) return util::counted(found, "homography", "homographies");
    std::string kinds;
    for (const auto& [geometry, count] : geometries_) {
      kinds += (kinds.empty() ? " (" : ", ") + std::to_string(count) + " " + toString(geometry);
    }
    if (parallaxes_.empty()) {
      return util::counted(found, "geometry", "geometries") + (kinds.empty() ? "" : kinds + ")");
    }
    std::string text =
        util::counted(found, "motion") + kinds +
        util::format("), median parallax %.2g degrees", metrics::median(parallaxes_));
    for (const auto& [doubt, count] : doubts_) {
      text += ", " + std::to_string(count) + " in doubt: " + toString(doubt);
    }
    return text;
  }

  /// Summary of the matching for users, in a few lines.
  std::string summary() const {
    std::size_t found = 0;
    // Images that could not be matched although they had a reference and enough features.
    std::size_t unmatched = 0;
    std::string others;
    for (const auto& [status, count] : statuses_) {
      if (status == Status::ok) {
        found = count;
        continue;
      }
      if (status != Status::no_reference && status != Status::too_few_features) unmatched += count;
      others +=
          (others.empty() ? "; without: " : ", ") + std::to_string(count) + " " + toString(status);
      if (status == Status::no_reference) others += reasons();
    }
    if (repeated_ > 0) {
      others += "\n" + util::counted(repeated_, "image repeats the one before, and is no new frame",
                                     "images repeat the one before, and are no new frames");
    }
    if (2 * with_still_things_ > found) {
      others += std::string("\n") + matching::kThingsStandStill + "; hide them with mask_image";
    }
    const std::string advice = unmatched > found ? noteOnSize(longer_side_) : "";
    others += noteOnGaps();
    if (growth_is_idle_ && unmatched > 0) {
      others +=
          "\ngrowth has no effect with reference_mode previous; with --reference_mode keyframe, "
          "images that only growth can match are matched, too";
    }
    if (!advice.empty()) others += "\n" + advice + " (--longest_side, for a pattern of images)";
    return successes(found) +
           util::format(", median of %.0f inliers, %.2f ms an image", metrics::median(inliers_),
                        metrics::median(milliseconds_)) +
           others + '\n';
  }

  /// Why images had no reference, for example " (first_frame: 1, size_changed: 5)". Empty if it was
  /// only the first image, as in every recording.
  std::string reasons() const {
    if (reasons_.size() == 1 && reasons_.count(NoReference::first_frame) > 0) return {};
    std::string text;
    for (const auto& [reason, count] : reasons_) {
      text += (text.empty() ? " (" : ", ") + std::string(toString(reason)) + ": " +
              std::to_string(count);
    }
    return text + ")";
  }

  /// Advice on max_reference_age if many images come so late after the image before that they have
  /// no reference; empty for other recordings.
  std::string noteOnGaps() const {
    constexpr double kMany = 0.1;  // of all images; a recording may have single pauses
    if (gaps_.size() <= kMany * static_cast<double>(matched_)) return {};
    constexpr double kLongest = 600.0;  // s; the largest value of max_reference_age
    const double step = metrics::median(gaps_);
    if (step > kLongest) return {};
    return "\n" + util::counted(gaps_.size(), "image has", "images have") +
           util::format(
               " no reference: they come about %.3g s after the image before, and "
               "max_reference_age is %.3g s; expected a larger one (--max_reference_age %.3g)",
               step, max_age_, std::min(kLongest, std::ceil(2.0 * step)));
  }

  /// Tells the user why the camera_info does not fit the images; only at the first such image.
  void explainNoMotion(const cv::Size& image) {
    if (!view_.camera || std::exchange(said_no_motion_, true)) return;
    try {
      twoViewCamera(*view_.camera, view_.pixels, image);
    } catch (const std::invalid_argument& error) {
      sayNoMotion(error.what());
    }
  }

  void finishOldest() {
    const auto [recorded, skipped] = std::move(waiting_.front());
    waiting_.pop_front();
    try {
      finish(recorded, skipped);
    } catch (const RefusedImage& error) {
      if (refused_++ == 0) refusal_ = error.what();
      std_msgs::Header header;
      header.stamp = recorded.stamp.isZero() ? recorded.received : recorded.stamp;
      writer_.writeUnused(recorded.image ? recorded.image->header : header, "refused",
                          error.what());
    }
    progress_.advance("images");
  }

  /// For an image that repeats the previous image: shows the last pictures in the videos once more,
  /// so that the videos keep the rate of the images.
  void finishRepeated(const std_msgs::Header& header) {
    ++repeated_;
    writer_.writeUnused(header, "repeated", "the image before once more");
    views_.repeat();
    if (drawing_ && !drawn_.empty()) drawing_->write(drawn_);
  }

  void finish(const RecordedImage& recorded, std::uint64_t skipped) {
    if (!recorded.image) throw RefusedImage(recorded.problem);
    auto [frame, ahead] = pipeline_.pop();
    if (!frame->camera) explainNoMotion(frame->image.size());
    MatchedFrame matched = matcher_.process(recorded.image->header, frame, &ahead);
    if (matched.match.repeated) return finishRepeated(recorded.image->header);
    matched.refused = refused_;
    matched.skipped = skipped;
    matched.repeated = repeated_;
    FrameMessages messages = toMessages(matched);
    const sensor_msgs::ImagePtr picture =
        draws_overlay_ || drawing_ ? matcher_.overlay(recorded.image) : nullptr;
    if (draws_overlay_) messages.overlay = picture;
    if (drawing_ && picture) {
      drawn_ = cv_bridge::toCvCopy(picture)->image;
      drawing_->write(drawn_);
    }
    views_.add(recorded.image, *messages.homography);  // may refuse the image
    writer_.write(messages, recorded.received);
    ++matched_;
    const cv::Size size = frame->image.size();
    longer_side_ = std::max({longer_side_, size.width, size.height});
    count(messages);
    const ros::Time& stamp = recorded.image->header.stamp;
    if (messages.statistics->reason == static_cast<std::uint8_t>(NoReference::gap))
      gaps_.push_back(secondsBetween(last_stamp_, stamp));
    last_stamp_ = stamp;
    if (!is_fixed_ && matched.match.match.hasStillThings()) ++with_still_things_;
    motion_.add(*messages.homography, sizeOf(*recorded.image));
    const TargetDetectionsPtr detections = targets_.find(recorded.image);
    writer_.write(detections_topic_, detections, recorded.received);
  }

  void count(const FrameMessages& messages) {
    const MatchStatistics& statistics = *messages.statistics;
    const auto status = static_cast<Status>(statistics.status);
    ++statuses_[status];
    milliseconds_.push_back(statistics.total_milliseconds);
    if (status == Status::no_reference) ++reasons_[static_cast<NoReference>(statistics.reason)];
    if (status != Status::ok) return;
    inliers_.push_back(statistics.inliers);
    ++geometries_[static_cast<Geometry>(statistics.geometry)];
    if (!messages.two_view || !messages.two_view->has_pose) return;
    parallaxes_.push_back(messages.two_view->parallax);
    const auto doubt = static_cast<Doubt>(messages.two_view->doubt);
    if (doubt != Doubt::none) ++doubts_[doubt];
  }

  files::Outputs outputs_;
  std::unique_ptr<ImageSource> source_;
  MessageMatcher matcher_;
  FramePipeline pipeline_;
  MatchWriter writer_;
  BagViews views_;
  BagMotion motion_;
  BagTargets targets_;
  std::string detections_topic_;
  std::optional<tools::VideoFile> drawing_;
  cv::Mat drawn_;  // last picture of the overlay video
  tools::ProgressBar progress_;
  RateLimiter rate_limiter_;
  CameraView view_;
  bool finds_motions_;  // whether the matcher estimates two-view geometries
  bool said_no_motion_ = false;
  bool is_fixed_;
  bool growth_is_idle_;  // growth is on, but it does not run for the previous frame
  bool draws_overlay_;
  bool discards_interrupted_;
  std::size_t matched_ = 0;
  int longer_side_ = 0;  // px
  std::map<Status, std::size_t> statuses_;
  std::map<NoReference, std::size_t> reasons_;  // why images had no reference
  std::map<Geometry, std::size_t> geometries_;
  std::map<Doubt, std::size_t> doubts_;
  std::vector<double> inliers_;       // number of inliers of each match with a geometry
  std::vector<double> parallaxes_;    // parallax of each camera motion, degrees
  std::vector<double> milliseconds_;  // processing time of each image, ms
  std::vector<double> gaps_;  // time from an image to the next, where longer than max_age_, s
  ros::Time last_stamp_;
  double max_age_;
  std::uint64_t skipped_ = 0;
  // Images that are in the pipeline, each with the number of images that were skipped just before
  // it.
  std::deque<std::pair<RecordedImage, std::uint64_t>> waiting_;
  std::size_t with_still_things_ = 0;  // frames
  std::uint64_t refused_ = 0;
  std::uint64_t repeated_ = 0;
  std::string refusal_;  // reason why the first unusable image was refused
};

/// Sets the camera for the two-view geometry. If there is no usable camera_info, tells the user
/// that only the geometry is estimated, but not the motion of the camera.
void setCamera(const Parameters& parameters, const std::string& bag, const std::string& topic,
               const std::optional<sensor_msgs::CameraInfo>& camera, Configuration& configuration) {
  if (configuration.sequence.matcher.geometry == GeometryModel::homography) return;
  std::string problem = "only a bag has camera_info; expected --camera fx,fy,cx,cy";
  if (camera || kindOf(bag) == InputKind::bag) {
    try {
      const sensor_msgs::CameraInfo info =
          camera ? *camera : readCameraInfo(bag, topic, "geometry " + parameters.geometry);
      twoViewCamera(info, configuration.view.pixels, imageSize(info));  // throws for a bad K
      configuration.view.camera = boost::make_shared<sensor_msgs::CameraInfo>(info);
      return;
    } catch (const std::exception& error) {
      if (camera) throw;
      problem = error.what();
    }
  }
  sayNoMotion(problem);
}

Configuration configurationFor(Parameters parameters, const std::string& bag,
                               const std::string& topic,
                               const std::optional<sensor_msgs::CameraInfo>& camera) {
  // Several images are processed in parallel, so each of them must use only one thread.
  parameters.threads = 1;
  Configuration configuration = configurationFrom(parameters, 0);
  configuration.reference_image = readImageFile("reference_image", parameters.reference_image);
  configuration.view.file_mask = readMaskFile(parameters.mask_image);
  const std::string idle = idleMask(configuration.view.file_mask);
  if (!idle.empty()) {
    std::cerr << "ktgp_bag: mask_image " + util::printable(parameters.mask_image) + ": it " + idle +
                     '\n';
  }
  configuration.view.pixels = pixelsFrom(parameters.calibration, topic);
  if (parameters.rectify && configuration.view.pixels == Pixels::rectified) {
    throw std::invalid_argument("rectify is on, but the images on " + topic +
                                " are rectified already (see the parameter calibration)");
  }
  if (parameters.rectify) {
    if (kindOf(bag) != InputKind::bag) {
      throw std::invalid_argument(bag + ": rectify needs camera_info, which only a bag has");
    }
    configuration.view.lens = lensFrom(readCameraInfo(bag, topic, "rectify"));
  }
  setCamera(parameters, bag, topic, camera, configuration);
  return configuration;
}

/// Warns if the camera_info of the recording changes: the node would use the new one, but this
/// program uses the first one for all images.
void sayIfCameraChanges(const Arguments& arguments, const std::string& topic) {
  const bool is_used = arguments.parameters.rectify || !arguments.motion.path.empty() ||
                       !arguments.targets.path.empty() ||
                       arguments.parameters.geometry != "homography";
  if (!is_used || kindOf(arguments.in) != InputKind::bag) return;
  try {
    const sensor_msgs::CameraInfo used = readCameraInfo(arguments.in, topic, "");
    const std::string change = changeOfCameraInfo(arguments.in, topic, used);
    if (!change.empty()) std::cerr << "ktgp_bag: " << change << '\n';
  } catch (const UnusableBag&) {
    // The recording has no camera_info. The part of the program that needs it reports this.
  }
}

void checkFiles(files::OutputPlan plan, const Arguments& arguments) {
  for (const std::string& file : filesOfInput(arguments.in)) plan.read(file);
  // These files may also be named in a parameter file or in a list of targets, so add them here.
  plan.read(arguments.parameters.reference_image);
  plan.read(arguments.parameters.mask_image);
  for (const std::string& file : filesOfTargets(arguments.targets.path)) plan.read(file);
  if (files::isStandardOutput(arguments.out)) {
    throw files::FileError(arguments.out, "is the standard output; expected a file for OUT.bag");
  }
  plan.write(arguments.out);
  plan.write(arguments.csv);
  plan.writeVideo(arguments.draw);
  plan.writeVideo(arguments.views.video);
  plan.write(arguments.views.warps);
  plan.writeImage(arguments.views.mosaic, files::PictureKind::transparent);
  // We do not know yet how many maps there will be, so check the name of the second one, and those
  // that exist: a later one is of an earlier run, and the third map would fail at the end.
  for (const std::string& map : furtherMaps(arguments.views.mosaic)) {
    plan.writeImage(map, files::PictureKind::transparent);
  }
  plan.write(arguments.views.mosaic_poses);
  plan.write(arguments.motion.path);
}

/// Names the files of which only the first page is used. The images of a pattern are read later,
/// and are then named by their source.
void notePages(const Arguments& arguments) {
  std::vector<std::string> names = filesOfTargets(arguments.targets.path);
  names.insert(names.end(), {arguments.in, arguments.parameters.reference_image,
                             arguments.parameters.mask_image});
  for (const std::string& file : names) {
    const std::string note = files::noteOnPages(file);
    if (!note.empty()) std::cerr << "ktgp_bag: " << note << '\n';
  }
}

int matchBag(const files::OutputPlan& plan, Arguments& arguments) {
  tools::stopWhenInterrupted();
  checkFiles(plan, arguments);
  notePages(arguments);
  if (!arguments.motion.path.empty() && kindOf(arguments.in) != InputKind::bag) {
    throw std::invalid_argument(arguments.in +
                                ": --motion needs camera_info, which only a bag has");
  }
  cv::setNumThreads(1);  // our own threads already use all cores
  auto source = openInput(arguments);
  if (!arguments.views.video.empty()) arguments.views.rate = pictureRate(arguments);
  const auto camera = givenCamera(arguments);
  Configuration configuration =
      configurationFor(arguments.parameters, arguments.in, source->topic(), camera);
  arguments.views.lens = configuration.view.lens;
  if (!camera) sayIfCameraChanges(arguments, source->topic());
  if (kindOf(arguments.in) == InputKind::images && arguments.rate > 0.0) {
    // At a low rate, the usual time between two images may be longer than max_age. Increase
    // max_age, so that neighbouring images are still matched.
    constexpr double kPeriods = 1.5;
    double& max_age = configuration.sequence.reference.max_age;
    max_age = std::max(max_age, kPeriods / arguments.rate);
  }
  const unsigned cores = std::max(1U, std::thread::hardware_concurrency());
  const int threads = arguments.parameters.threads;
  Run run(arguments, std::move(source), configuration, camera,
          threads > 0 ? threads : static_cast<int>(cores));
  const int code = run.run();
  run.report(arguments, code);
  return code;
}

/// Checks the name of a namespace of topics. ros::names::validate() also accepts names that nobody
/// can subscribe to, so we do not use it.
CLI::Validator nameOfTopics() {
  const auto check = [](const std::string& text) -> std::string {
    static const std::regex name("/?[A-Za-z][A-Za-z0-9_]*(/[A-Za-z0-9_]+)*");
    if (std::regex_match(text, name)) return {};
    return util::quoted(text) +
           " is no name in ROS; expected letters, digits and _, first a letter, in parts between "
           "single slashes: /robot1/matcher";
  };
  return CLI::Validator(check, "");
}

/// Returns true if the parameter has no effect with the given options and parameters.
bool isIdle(const CLI::App& app, const ParameterRow& row, const Parameters& all) {
  const bool is_fixed = all.reference_mode == "fixed";
  if (row.name == "reference_image" || row.name == "views") return !is_fixed;
  if (row.name == "max_reference_age") return is_fixed;
  if (row.name == "growth") return all.reference_mode == "previous";
  return row.name == "overlay_style" && app.count("--overlay") + app.count("--draw") == 0;
}

void addInputArguments(CLI::App& app, Arguments& arguments) {
  app.add_option("IN", arguments.in,
                 "recording to read: a bag, a video, or a pattern of images ('folder/*.png')")
      ->required();
  app.add_option(
      "--topic", arguments.selection.topic,
      "image topic in a bag, with or without /compressed; not needed if there is only one");
  app.add_option("--start", arguments.selection.start,
                 "start this long after the start of the recording [s]")
      ->check(tools::numberIn({0.0, 1e9}));
  app.add_option("--duration", arguments.selection.duration, "length of the part to use [s]")
      ->check(tools::numberIn({0.0, 1e9}));
  app.add_option(
         "--rate", arguments.rate,
         "images per second: of a pattern of images (30 without it), of a video in place of "
         "its own times")
      ->check(tools::numberIn({0.001, 10000.0}));
  app.add_option("--longest_side", arguments.longest_side,
                 "make larger images of a pattern so small before anything else [px]; all results "
                 "are in px of the small ones, but --camera is that of the files")
      ->check(tools::wholeNumberIn(32, 100000));
  tools::addCameraOption(app, "--camera", arguments.camera,
                         "K of the images without distortion, px of the files, where there is no "
                         "camera_info: "
                         "for the motion of the "
                         "camera (--geometry auto, --preset slam), poses of targets, and panoramas "
                         "(--mosaic)");
}

void addArguments(CLI::App& app, Arguments& arguments) {
  addInputArguments(app, arguments);
  app.add_option("OUT.bag", arguments.out, "bag to write")->required();
  app.add_option("--name", arguments.name,
                 "namespace of the output topics; without it: matcher beside the image topic")
      ->check(nameOfTopics());
  app.add_option("--csv", arguments.csv,
                 "write a table with a line for every image; - is the standard output")
      ->type_name("FILE");
  app.add_flag("--overlay", arguments.overlay, "write matches_image to the bag, too");
  app.add_flag(
      "--skip_finished", arguments.skip_finished,
      "for one command per recording, run again until all are done (see doc/fleet.md): if "
      "OUT.bag exists, do nothing but return the same exit code; an interrupted run leaves no "
      "files");
  app.add_option("--draw", arguments.draw,
                 "write a video (mp4) of the matches in the images, as --overlay_style says")
      ->type_name("FILE")
      ->group("To look at");
  addViewOptions(app, arguments.views);
  addMotionArguments(app, arguments.motion);
  addTargetsArguments(app, arguments.targets);
  tools::addCommonOptions(app, arguments.force);
  tools::addParameterOptions(
      app, arguments.parameters,
      [&app](const ParameterRow& row, const Parameters& all) { return isIdle(app, row, all); });
}

/// Throws std::invalid_argument if an option would have no effect with the given values of the
/// other options.
void refuseIdleOptions(const CLI::App& app, const Arguments& arguments) {
  const Parameters& parameters = arguments.parameters;
  const GroundMotionConfig& motion = arguments.motion.config;
  const bool posed = app.count("--targets") + app.count("--motion") + app.count("--mosaic") > 0 ||
                     parameters.geometry != "homography";
  const auto refuse_unless = [&app](bool used, const char* option, const char* condition) {
    if (used || app.count(option) == 0) return;
    throw std::invalid_argument(std::string(option) + " has no effect: it is used only with " +
                                condition + "; leave it out");
  };
  const auto is_used = [&](const char* name) {
    return !isIdle(app, *findParameter(name), parameters);
  };
  refuse_unless(is_used("reference_image"), "--reference_image", "--reference_mode fixed");
  refuse_unless(posed, "--calibration",
                "--targets, --motion, --mosaic, or --geometry auto or epipolar");
  refuse_unless(posed, "--camera", "--targets, --motion, --mosaic, or --geometry auto or epipolar");
  refuse_unless(kindOf(arguments.in) == InputKind::images, "--longest_side", "a pattern of images");
  refuse_unless(motion.height_source == "parameter", "--motion_height",
                "--motion_height_source parameter");
  refuse_unless(motion.height_source == "range", "--motion_range", "--motion_height_source range");
  refuse_unless(motion.normal_source == "imu" || motion.gyro, "--motion_imu",
                "--motion_normal_source imu or --motion_gyro");
  refuse_unless(is_used("overlay_style"), "--overlay_style", "--overlay or --draw");
  if (is_used("reference_image") && parameters.reference_image.empty()) {
    throw std::invalid_argument(
        "reference_mode is fixed, and there is no reference; expected --reference_image FILE");
  }
}

int run(int argc, char** argv) {
  Arguments arguments;
  arguments.parameters.threads = 0;
  CLI::App app(
      "Matches the images of a recording as the nodelet would, but drops none and uses all cores.");
  addArguments(app, arguments);
  app.footer(std::string("Examples:\n"
                         "  ktgp_bag my.bag matched.bag --csv matched.csv\n"
                         "  ktgp_bag my.mp4 matched.bag --preset robust --draw matches.mp4\n"
                         "  ktgp_bag 'images/*.png' matched.bag --rate 10 --mosaic map.png\n"
                         "  ktgp_bag 'flight/*.jpg' matched.bag --rate 0.5 --longest_side 1000 "
                         "--preset photo --mosaic map.png\n\n"
                         "The parameter threads is the number of images processed in parallel; its "
                         "default differs from that\nof the nodelet.\n\n") +
             tools::kExitCodes + "\nAfter 1 and 130, OUT.bag has the results up to that point.");
  const auto code = tools::parse(app, argc, argv,
                                 "a pattern of images goes in quotes ('folder/*.png'), because "
                                 "the shell replaces one without them by the names of the files");
  if (code) return *code;
  refuseIdleOptions(app, arguments);
  completeViewOptions(app, arguments.views);
  arguments.motion.config.calibration = arguments.parameters.calibration;
  arguments.targets.calibration = arguments.parameters.calibration;
  std::error_code none;  // ignored: a bad name is refused later
  if (arguments.skip_finished && std::filesystem::is_regular_file(arguments.out, none) &&
      !files::isInterrupted(arguments.out)) {
    const std::string unused = unusedPartOf(arguments.out);
    // Write the line in one piece, because other processes may write to the same terminal.
    std::cerr << arguments.out + " is finished" +
                     (unused.empty() ? "" : ", without a part of the recording: " + unused) + '\n';
    return unused.empty() ? tools::kExitDone : tools::kExitUnusedData;
  }
  return matchBag(tools::planOutputs(app, arguments.force), arguments);
}

}  // namespace
}  // namespace ktgp_orb::tools

int main(int argc, char** argv) {
  return ktgp_orb::tools::runProgram("ktgp_bag", [&] { return ktgp_orb::tools::run(argc, argv); });
}
