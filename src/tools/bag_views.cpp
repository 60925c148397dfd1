#include "tools/bag_views.h"

#include <Eigen/LU>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <stdexcept>

#include "files/csv.h"
#include "files/input.h"
#include "parameters/parameters.h"
#include "ros/image_conversion.h"
#include "ros/message_conversion.h"
#include "stabilization/steady_path.h"
#include "tools/bag_writer.h"
#include "tools/matcher_cli.h"
#include "util/counted.h"
#include "util/format.h"
#include "util/milliseconds.h"

namespace ktgp_orb::tools {
namespace {

// path_ keeps the homographies of this many frames (see FramePath).
constexpr std::size_t kPath = 600;
constexpr double kNoShake = 0.5;  // px; smaller shake is invisible

}  // namespace

void addViewOptions(CLI::App& app, ViewOptions& views) {
  const char* const group = "To look at";
  CLI::Option* const video =
      app.add_option("--stabilize", views.video,
                     "write a steady video (mp4) of the images, on the steadiest path over the "
                     "whole recording; with --stabilizer_lag, on a path found frame by frame, as "
                     "the node does")
          ->type_name("FILE")
          ->group(group);
  const auto add = [&](CLI::Option* of, const char* name, auto& value, const char* text = "") {
    return app.add_option(name, value, text)->capture_default_str()->needs(of)->group(group);
  };
  CLI::Option* const lag = add(video, "--stabilizer_lag", views.stabilizer.lag)->default_str("");
  tools::describe(lag, "stabilizer");
  tools::describe(add(lag, "--stabilizer_strength", views.stabilizer.strength), "stabilizer");
  tools::describe(add(video, "--stabilizer_max_crop", views.stabilizer.max_crop), "stabilizer");
  add(video, "--stabilizer_warps", views.warps,
      "write a table with the image -> steady image homography of every image; needs --stabilize")
      ->type_name("FILE");
  CLI::Option* const map =
      app.add_option(
             "--mosaic", views.mosaic,
             "write the mosaic as a picture (png); further maps, after a cut for example, are in "
             "FILE-2 and so on")
          ->type_name("FILE")
          ->group(group);
  add(map, "--mosaic_keyframes", views.map.keyframes,
      "place frames by matches to keyframes; false: by the homographies alone");
  tools::describe(add(map, "--mosaic_max_megapixels", views.map.max_megapixels), "mosaic");
  add(map, "--mosaic_poses", views.mosaic_poses,
      "write a table with the homography of every image from the first frame of its map; needs "
      "--mosaic")
      ->type_name("FILE");
}

void completeViewOptions(const CLI::App& app, ViewOptions& views) {
  views.whole = app.get_option("--stabilizer_lag")->count() == 0;
  if (!views.video.empty() && views.whole && !hasSteadyPath()) {
    throw std::invalid_argument(
        "--stabilize needs a solver for the path over the whole recording, and this program was "
        "built without Clp (Debian's coinor-libclp-dev); expected --stabilizer_lag N, for example "
        "30, or a build with it");
  }
}

void SteadyVideo::Shake::finishPart(const cv::Size& size) {
  if (steps.size() >= 2) {
    const double weight = static_cast<double>(steps.size() - 1);
    sum += weight * shakeOf(steps, size);
    count += weight;
  }
  steps.clear();
}

namespace {

/// Returns the image that the homographies refer to: without lens distortion if `options` has a
/// lens for this image size, otherwise unchanged.
cv::Mat pictureOf(const sensor_msgs::ImageConstPtr& image, const ViewOptions& options) {
  cv::Mat picture = colourImage(image);
  if (!options.lens || options.lens->calibration().image_size != picture.size()) return picture;
  cv::Mat rectified;
  options.lens->rectify(picture, rectified);
  return rectified;
}

}  // namespace

SteadyVideo::SteadyVideo(const ViewOptions& options, Reopen reopen, files::Outputs& outputs)
    : options_(options),
      reopen_(std::move(reopen)),
      outputs_(outputs),
      video_(options.video, options.rate, outputs),
      path_(kPath),
      stabilizer_(options.stabilizer) {}

void SteadyVideo::add(const sensor_msgs::ImageConstPtr& image, std::int64_t stamp,
                      std::int64_t reference, const std::optional<Eigen::Matrix3d>& homography) {
  const cv::Mat frame = pictureOf(image, options_);
  const std::optional<std::int64_t> previous =
      path_.steps().empty() ? std::nullopt : std::make_optional(path_.steps().back().stamp);
  std::optional<Eigen::Matrix3d> step;
  if (path_.add(stamp, reference, homography) && previous) step = path_.between(*previous, stamp);
  if (options_.whole) {
    frames_.push_back({stamp, frame.size(), step, 0});
    return;
  }
  waiting_.push_back({frame.clone(), step, 0});
  stabilizer_.add(stamp, reference, homography, frame.size(), ready_);
  writeReady();
}

void SteadyVideo::repeat() {
  if (options_.whole) {
    if (!frames_.empty()) ++frames_.back().repeats;
  } else if (!waiting_.empty()) {
    ++waiting_.back().repeats;
  } else if (!picture_.empty()) {
    video_.write(picture_);
  }
}

void SteadyVideo::writeReady() {
  for (const SteadyFrame& steady : ready_) {
    write(steady, waiting_.front());
    waiting_.pop_front();
  }
  ready_.clear();
}

/// Computes the steady path over the whole recording. When the size of the images changes, a new
/// path begins.
std::vector<SteadyFrame> SteadyVideo::wholePath() const {
  std::vector<SteadyFrame> path;
  for (auto begin = frames_.begin(); begin != frames_.end();) {
    const auto end = std::find_if(
        begin, frames_.end(), [&begin](const Frame& frame) { return frame.size != begin->size; });
    std::vector<std::optional<Eigen::Matrix3d>> steps;
    std::transform(begin, end, std::back_inserter(steps),
                   [](const Frame& frame) { return frame.step; });
    steps.front().reset();
    const auto warps = steadyPath(steps, begin->size, options_.stabilizer.max_crop);
    for (std::size_t i = 0; i < warps.size(); ++i) {
      path.push_back({(begin + static_cast<std::ptrdiff_t>(i))->stamp, warps[i], !steps[i]});
    }
    begin = end;
  }
  return path;
}

void SteadyVideo::writeWhole() {
  const std::vector<SteadyFrame> path = wholePath();
  if (path.empty()) return;
  const std::unique_ptr<ImageSource> images = reopen_();
  std::size_t next = 0;
  while (next < path.size()) {
    const auto recorded = images->next();
    if (!recorded) throw files::FileError(options_.video, "the recording has changed meanwhile");
    if (!recorded->image) continue;
    // If the stamps differ, this image was skipped or refused, so it is not in the path.
    if (stampOf(recorded->image->header.stamp) != path[next].stamp) continue;
    cv::Mat frame;
    try {
      frame = pictureOf(recorded->image, options_);
    } catch (const RefusedImage&) {
      continue;
    }
    write(path[next], {frame, frames_[next].step, frames_[next].repeats});
    ++next;
  }
}

void SteadyVideo::write(const SteadyFrame& steady, const Waiting& frame) {
  const auto start = std::chrono::steady_clock::now();
  picture_ = warped(frame.image, steady.warp);
  milliseconds_ += util::millisecondsSince(start);
  ++written_;
  for (int i = 0; i <= frame.repeats; ++i) video_.write(picture_);
  if (!options_.warps.empty()) {
    warps_ += files::CsvRow()
                  .add(textOf(timeOf(steady.stamp)))
                  .add(steady.starts_anew ? 1 : 0)
                  .add(steady.warp)
                  .line();
  }
  if (frame.step && last_ && !steady.starts_anew) {
    before_.steps.push_back(*frame.step);
    after_.steps.emplace_back(steady.warp * *frame.step * last_->warp.inverse());
  } else {
    before_.finishPart(size_);
    after_.finishPart(size_);
  }
  last_ = steady;
  size_ = frame.image.size();
}

void SteadyVideo::close() {
  if (options_.whole) {
    writeWhole();
  } else {
    stabilizer_.flush(ready_);
    writeReady();
  }
  before_.finishPart(size_);
  after_.finishPart(size_);
  if (!video_.empty()) video_.close();
  if (options_.warps.empty()) return;
  outputs_.writeText(options_.warps,
                     std::string("stamp,starts_anew,") + files::kHomographyColumns + '\n' + warps_);
}

std::string SteadyVideo::report() const {
  if (written_ == 0) return options_.video + ": not written, since no image could be used\n";
  const std::string path = options_.whole
                               ? "the path of the whole recording"
                               : std::to_string(options_.stabilizer.lag) + " frames late";
  const double before = std::sqrt(before_.mean());
  return options_.video +
         util::format(": %s, shake %.2f px before%s, %.2f planned after, %s, %.2f ms a frame\n",
                      util::counted(written_, "frame").c_str(), before,
                      before < kNoShake ? " (none to remove)" : "", std::sqrt(after_.mean()),
                      path.c_str(), milliseconds_ / static_cast<double>(written_));
}

std::string mosaicOf(const std::string& path, std::size_t number) {
  if (number == 1) return path;
  const std::filesystem::path first(path);
  const std::string name =
      first.stem().string() + "-" + std::to_string(number) + first.extension().string();
  return (first.parent_path() / name).string();
}

namespace {

/// The files of maps from `first` on that exist.
std::vector<std::string> existingMaps(const std::string& path, std::size_t first) {
  constexpr std::size_t kMost = 999;  // "map-2026.png" is rather a picture of that year
  std::vector<std::string> maps;
  std::error_code none;
  for (std::size_t number = first; number <= kMost; ++number) {
    const std::string map = mosaicOf(path, number);
    if (std::filesystem::exists(std::filesystem::symlink_status(map, none))) maps.push_back(map);
  }
  return maps;
}

}  // namespace

std::vector<std::string> furtherMaps(const std::string& path) {
  if (path.empty()) return {};
  std::vector<std::string> maps = existingMaps(path, 3);
  maps.insert(maps.begin(), mosaicOf(path, 2));
  return maps;
}

BagViews::BagViews(const ViewOptions& options, Reopen reopen, files::Outputs& outputs,
                   std::optional<sensor_msgs::CameraInfo> camera, Pixels pixels)
    : options_(options),
      outputs_(outputs),
      mosaic_(options.map),
      camera_(std::move(camera)),
      pixels_(pixels) {
  if (!options.video.empty()) steady_.emplace(options, std::move(reopen), outputs);
  if (!options.mosaic.empty()) {
    mosaic_.onFinishedMap([this](const cv::Mat& image) { writeMap(image); });
  }
}

void BagViews::add(const sensor_msgs::ImageConstPtr& image, const HomographyStamped& message) {
  const std::optional<Eigen::Matrix3d> h = homographyOf(message);
  const std::int64_t stamp = stampOf(image->header.stamp);
  const std::int64_t reference = stampOf(message.reference_stamp);
  if (steady_) steady_->add(image, stamp, reference, h);
  if (options_.mosaic.empty()) return;
  const auto start = std::chrono::steady_clock::now();
  mosaic_.setCamera(camera_ ? cameraIfUsable(*camera_, pixels_, sizeOf(*image)) : std::nullopt);
  mosaic_.follow(stamp, reference, h);
  const Placement placement = mosaic_.place(stamp, pictureOf(image, options_));
  place_milliseconds_ += util::millisecondsSince(start);
  ++placed_;
  lost_ += placement == Placement::lost ? 1 : 0;
  repeated_ += mosaic_.lostBecause() == LostBecause::repeats ? 1 : 0;
  const std::string why = mosaic_.whyLost();
  unfit_ += why.empty() ? 0 : 1;
  if (!why.empty()) why_unfit_ = why;
  // With several maps, the last reason is given, because the frames were lost in different ones.
  if (!mosaic_.panorama() && maps_ == 0) unfit_before_turn_ = unfit_;
  if (options_.mosaic_poses.empty()) return;
  poses_ += files::CsvRow()
                .add(textOf(image->header.stamp))
                .add(toString(placement))
                .add(mosaic_.maps())
                .add(mosaic_.pose().value_or(Eigen::Matrix3d::Zero()))
                .line();
}

void BagViews::writeMap(const cv::Mat& image) {
  outputs_.writeImage(mosaicOf(options_.mosaic, ++maps_), image);
}

void BagViews::close() {
  const cv::Mat map = options_.mosaic.empty() ? cv::Mat() : mosaic_.image();
  if (!map.empty()) writeMap(map);
  if (steady_) steady_->close();
  if (!options_.mosaic_poses.empty()) {
    outputs_.writeText(options_.mosaic_poses, std::string("stamp,placement,map,") +
                                                  files::kHomographyColumns + '\n' + poses_);
  }
}

/// Describes the panorama for the user; empty if the last map is not drawn on a cylinder.
std::string BagViews::panorama() const {
  const auto panorama = mosaic_.panorama();
  if (!panorama) return {};
  const std::string closed =
      panorama->closed_off > 0.0
          ? util::format("; its end met its beginning %.1f px off", panorama->closed_off)
          : "";
  return util::format(
      "%s: the camera only turns: %.0f degrees of the turn, on a cylinder; focal length %.0f px, "
      "%s%s\n",
      options_.mosaic.c_str(), panorama->degrees, panorama->camera(0, 0),
      !panorama->is_estimated ? "as given"
      : camera_               ? "as the homographies tell, which the given camera does not fit"
                              : "as the homographies tell",
      closed.c_str());
}

std::string BagViews::report() const {
  std::string text;
  if (steady_) text += steady_->report();
  if (!options_.mosaic.empty() && maps_ == 0) {
    text += options_.mosaic + ": not written, since no image could be used\n";
  } else if (!options_.mosaic.empty()) {
    text += options_.mosaic;
    if (maps_ > 1) {
      text += " to " + mosaicOf(options_.mosaic, maps_) + ": " + std::to_string(maps_) +
              " maps, each in a file; the last";
    }
    text += util::format(
        ": %dx%d px; %s, %zu of them lost, %s, %.2f ms a frame%s\n", mosaic_.area().width,
        mosaic_.area().height, util::counted(placed_, "frame").c_str(), lost_,
        util::counted(mosaic_.keyframes(), "keyframe").c_str(),
        place_milliseconds_ / static_cast<double>(std::max<std::size_t>(placed_, 1)),
        mosaic_.full() ? "; full, some was left out" : "");
    for (const std::string& map : existingMaps(options_.mosaic, maps_ + 1)) {
      text += map + ": is of an earlier run; remove it if it is not needed\n";
    }
    if (repeated_ > 0) {
      text += options_.mosaic + ": " + util::counted(repeated_, "frame") +
              " not drawn, because the ground looks alike in several places\n";
    }
    text += panorama();
    if (unfit_ > 0) {
      const bool before_turn = mosaic_.panorama() && unfit_ == unfit_before_turn_;
      text +=
          options_.mosaic + ": " + util::counted(unfit_, "frame") + " lost" +
          (before_turn ? " before the turn was large enough for a cylinder" : ": " + why_unfit_) +
          '\n';
    }
    if (mosaic_.hasParallax()) {
      text += util::format(
          "%s: %s: points are about %.1f px off the map, and what is near is drawn several times\n",
          options_.mosaic.c_str(),
          mosaic_.panorama() ? "the camera does not only turn" : "the scene is no plane",
          mosaic_.planeDeviation());
    }
  }
  return text;
}

}  // namespace ktgp_orb::tools
