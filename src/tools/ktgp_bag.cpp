// Matches the images of a recording without playing it: uses all cores, drops no image, and gives
// the same messages as the nodelet.

#include <ktgp_orb/MatchStatus.h>

#include <algorithm>
#include <iostream>
#include <opencv2/core/utility.hpp>
#include <thread>
#include <utility>

#include "bag/reader.h"
#include "bag/video.h"
#include "cli/files.h"
#include "cli/matcher_cli.h"
#include "cli/output_file.h"
#include "cli/program.h"
#include "cli/progress_bar.h"
#include "messages/camera.h"
#include "messages/image_conversion.h"
#include "messages/message_matcher.h"
#include "messages/rate_limiter.h"
#include "tools/bag_motion.h"
#include "tools/bag_pipeline.h"
#include "tools/bag_targets.h"
#include "tools/bag_views.h"
#include "tools/bag_writer.h"
#include "tools/batch.h"
#include "tools/batch_options.h"
#include "tools/idle_options.h"
#include "tools/recording.h"
#include "tools/view_options.h"

namespace ktgp_orb {
namespace {

struct Arguments {
  std::string in;
  std::string out;
  BagSelection selection;
  std::string name;
  std::string csv;
  bool overlay = false;
  double rate = 0.0;  ///< 1/s; 0: the times of the recording
  ViewOptions views;
  MotionFile motion;
  TargetsInput targets;
  bool force = false;
  bool measured_times = true;  ///< zero in a batch, whose files are the same on every machine
  BatchOptions batch;
  Parameters parameters;
};

std::unique_ptr<ImageSource> openInput(const Arguments& arguments) {
  constexpr double kUsualRate = 30.0;
  if (kindOf(arguments.in) != InputKind::images) tools::requireRegularFile(arguments.in);
  switch (kindOf(arguments.in)) {
    case InputKind::video:
      return openVideo(arguments.in, arguments.selection, arguments.rate);
    case InputKind::images:
      return openImages(arguments.in, arguments.selection,
                        arguments.rate > 0.0 ? arguments.rate : kUsualRate);
    case InputKind::bag:
      break;
  }
  if (arguments.rate > 0.0) {
    throw std::invalid_argument(
        "--rate has no effect: a bag has the times of its images; leave it out");
  }
  return openBag(arguments.in, arguments.selection);
}

/// Namespace of the output: beside the image topic, as for the nodelet.
std::string outputNames(const std::string& name, const std::string& topic, const char* nodelet) {
  return name.empty() ? cameraOf(topic) + "/" + nodelet : name;
}

void eraseTimes(MatchStatistics& statistics) {
  for (StageStatistics& stage : statistics.stages) stage.milliseconds = 0.0;
  statistics.extraction_milliseconds = 0.0;
  statistics.total_milliseconds = 0.0;
  statistics.latency_milliseconds = 0.0;
}

/// The sequential part of the work, frame by frame.
class Run {
 public:
  Run(const Arguments& arguments, std::unique_ptr<ImageSource> source,
      const Configuration& configuration, int threads)
      : source_(std::move(source)),
        matcher_(configuration),
        pipeline_(configuration, fixedReference(configuration), threads),
        writer_(arguments.out, arguments.csv,
                outputNames(arguments.name, source_->topic(), "matcher"), arguments.force),
        views_(arguments.views, [&arguments] { return openInput(arguments); }),
        motion_(arguments.motion, arguments.in, source_->topic()),
        targets_(arguments.targets, arguments.in, source_->topic()),
        detections_topic_(outputNames(arguments.name, source_->topic(), "targets") + "/detections"),
        progress_(source_->total()),
        draws_overlay_(arguments.overlay),
        measured_times_(arguments.measured_times) {
    rate_limiter_.setRate(configuration.max_rate);
  }

  int run() {
    while (!tools::interrupted()) {
      auto recorded = source_->next();
      if (!recorded) break;
      if (isSkipped(*recorded)) continue;
      if (recorded->image) pipeline_.push(recorded->image);
      waiting_.push_back({std::move(*recorded), skipped_});
      if (pipeline_.full()) finishOldest();
    }
    while (!waiting_.empty()) finishOldest();
    writer_.close();
    views_.close();
    motion_.close();
    if (tools::interrupted()) return tools::kExitInterrupted;
    return source_->damage().empty() && refused_ == 0 ? tools::kExitDone : tools::kExitUnusedData;
  }

  std::size_t matched() const { return matched_; }
  std::size_t found() const { return found_; }
  std::uint64_t skipped() const { return skipped_; }
  std::uint64_t refused() const { return refused_; }
  /// The reason for the first of them.
  const std::string& refusal() const { return refusal_; }
  const std::string& topic() const { return source_->topic(); }
  std::string viewReport() const { return views_.report() + motion_.report() + targets_.report(); }
  std::string damage() const { return source_->damage(); }

 private:
  FrameConstPtr fixedReference(const Configuration& configuration) const {
    const bool fixed = configuration.sequence.reference.mode == ReferenceMode::fixed;
    return fixed ? matcher_.fixedReference() : nullptr;
  }

  bool isSkipped(const RecordedImage& recorded) {
    if (!recorded.image || rate_limiter_.takes(recorded.image->header.stamp)) return false;
    ++skipped_;
    progress_.advance("images");
    return true;
  }

  void finishOldest() {
    const auto [recorded, skipped] = std::move(waiting_.front());
    waiting_.pop_front();
    try {
      finish(recorded, skipped);
    } catch (const RefusedImage& error) {
      if (refused_++ == 0) refusal_ = error.what();
      std_msgs::Header header;
      header.stamp = recorded.received;
      writer_.writeRefused(recorded.image ? recorded.image->header : header, error.what());
    }
    progress_.advance("images");
  }

  void finish(const RecordedImage& recorded, std::uint64_t skipped) {
    if (!recorded.image) throw RefusedImage("compressed image cannot be decoded");
    FramePipeline::Prepared prepared = pipeline_.pop();
    MatchedFrame matched = matcher_.process(recorded.image->header, prepared.frame,
                                            prepared.ahead ? &*prepared.ahead : nullptr);
    matched.refused = refused_;
    matched.skipped = skipped;
    FrameMessages messages = toMessages(matched);
    if (draws_overlay_) messages.overlay = matcher_.overlay();
    if (!measured_times_) eraseTimes(*messages.statistics);
    writer_.write(messages, recorded.received);
    ++matched_;
    found_ += messages.homography->status == MatchStatus::STATUS_OK ? 1 : 0;
    views_.add(recorded.image, *messages.homography);
    motion_.add(*messages.homography, cv::Size(static_cast<int>(recorded.image->width),
                                               static_cast<int>(recorded.image->height)));
    const TargetDetectionsPtr detections = targets_.find(recorded.image);
    if (detections && !measured_times_) detections->milliseconds = 0.0;
    writer_.write(detections_topic_, detections, recorded.received);
  }

  std::unique_ptr<ImageSource> source_;
  MessageMatcher matcher_;
  FramePipeline pipeline_;
  MatchWriter writer_;
  BagViews views_;
  BagMotion motion_;
  BagTargets targets_;
  std::string detections_topic_;
  tools::ProgressBar progress_;
  RateLimiter rate_limiter_;
  bool draws_overlay_;
  bool measured_times_;
  std::size_t matched_ = 0;
  std::size_t found_ = 0;
  std::uint64_t skipped_ = 0;
  std::deque<std::pair<RecordedImage, std::uint64_t>>
      waiting_;  // in the pipeline; number skipped before
  std::uint64_t refused_ = 0;
  std::string refusal_;
};

int threadsFrom(const Parameters& parameters) {
  if (parameters.threads > 0) return parameters.threads;
  return static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
}

Configuration configurationFor(Parameters parameters, const std::string& bag,
                               const std::string& topic) {
  parameters.threads = 1;  // per image; several images are processed in parallel
  Configuration configuration = configurationFrom(parameters, 0);
  configuration.reference_image = readImageFile("reference_image", parameters.reference_image);
  configuration.view.file_mask = readMaskFile(parameters.mask_image);
  if (parameters.rectify) {
    if (kindOf(bag) != InputKind::bag) {
      throw std::invalid_argument(bag + ": rectify needs camera_info, which only a bag has");
    }
    configuration.view.lens = lensFrom(readCameraInfo(bag, topic));
  }
  return configuration;
}

void checkFiles(Arguments& arguments) {
  tools::OutputPlan plan(arguments.force);
  for (const std::string& file : filesOfInput(arguments.in)) plan.read(file);
  plan.read(arguments.parameters.reference_image);
  plan.read(arguments.parameters.mask_image);
  for (const std::string& file : filesOfTargets(arguments.targets.path)) plan.read(file);
  plan.write(arguments.out);
  plan.write(arguments.csv);
  plan.writeVideo(arguments.views.steady.video);
  plan.write(arguments.views.steady.warps);
  plan.writeImage(arguments.views.mosaic);
  // The number of maps is not known beforehand; old files are checked.
  if (!arguments.views.mosaic.empty()) plan.writeImage(mosaicOf(arguments.views.mosaic, 2));
  plan.write(arguments.views.mosaic_poses);
  plan.write(arguments.motion.path);
}

/// Of the steady video.
double pictureRate(const Arguments& arguments) {
  if (arguments.rate > 0.0) return arguments.rate;
  const bool video = kindOf(arguments.in) == InputKind::video;
  const double rate = video ? rateOfVideo(arguments.in) : 0.0;
  return rate > 0.0 ? rate : arguments.views.steady.rate;
}

Outcome matchBag(Arguments& arguments) {
  std::string& topic = arguments.selection.topic;
  if (!topic.empty() && topic[0] != '/') topic.insert(0, "/");
  tools::stopWhenInterrupted();
  checkFiles(arguments);
  if (!arguments.motion.path.empty() && kindOf(arguments.in) != InputKind::bag) {
    throw std::invalid_argument(arguments.in +
                                ": --motion needs camera_info, which only a bag has");
  }
  cv::setNumThreads(1);  // the images are distributed over the cores
  auto source = openInput(arguments);
  if (!arguments.views.steady.video.empty()) arguments.views.steady.rate = pictureRate(arguments);
  const Configuration configuration =
      configurationFor(arguments.parameters, arguments.in, source->topic());
  Run run(arguments, std::move(source), configuration, threadsFrom(arguments.parameters));
  const int code = run.run();
  Outcome outcome{code, run.matched(), run.refused(), run.skipped(), run.found()};
  std::cerr << (code == tools::kExitInterrupted ? "interrupted: " : "") << run.matched()
            << " images of " << run.topic() << " matched, " << run.refused() << " refused, "
            << run.skipped() << " skipped by max_rate; results in " << arguments.out << '\n'
            << run.viewReport();
  if (run.refused() > 0) {
    outcome.reason = std::to_string(run.refused()) +
                     " images could not be used, the first because: " + run.refusal();
    std::cerr << "ktgp_bag: " << arguments.in << ": " << outcome.reason << '\n';
  }
  if (!run.damage().empty()) {
    outcome.reason += (outcome.reason.empty() ? "" : "; ") + run.damage();
    std::cerr << "ktgp_bag: " << arguments.in << ": " << run.damage() << "\nWhat could be read is "
              << "matched; 'rosbag reindex' may repair a bag.\n";
  }
  return outcome;
}

/// One recording of a batch: the names of the files are below its folder.
Outcome matchInto(Arguments arguments, const std::string& input, const std::string& folder) {
  arguments.in = input;
  arguments.out = folder + "/matched.bag";
  for (std::string* file :
       {&arguments.csv, &arguments.views.steady.video, &arguments.views.steady.warps,
        &arguments.views.mosaic, &arguments.views.mosaic_poses, &arguments.motion.path}) {
    if (!file->empty()) file->insert(0, folder + "/");
  }
  arguments.measured_times = false;
  if (arguments.parameters.threads == 0) {
    arguments.parameters.threads =
        std::max(1, threadsFrom(arguments.parameters) / arguments.batch.jobs);
  }
  return matchBag(arguments);
}

void addArguments(CLI::App& app, Arguments& arguments) {
  app.add_option("IN", arguments.in,
                 "recording to read: a bag, a video, or a pattern of images ('folder/*.png')")
      ->configurable(false);
  app.add_option("OUT.bag", arguments.out, "bag to write")->configurable(false);
  app.add_option("--topic", arguments.selection.topic,
                 "image topic in a bag, raw or compressed; not needed if there is only one");
  app.add_option("--start", arguments.selection.start,
                 "start this long after the start of the recording [s]")
      ->check(tools::numberIn({0.0, 1e9}));
  app.add_option("--duration", arguments.selection.duration, "length of the part to use [s]")
      ->check(tools::numberIn({0.0, 1e9}));
  app.add_option("--name", arguments.name,
                 "namespace of the output topics; without it: matcher beside the image topic");
  app.add_option(
         "--rate", arguments.rate,
         "images per second: of a pattern of images (30 without it), of a video in place of "
         "its own times")
      ->check(tools::numberIn({0.001, 10000.0}));
  app.add_option("--csv", arguments.csv,
                 "write a table with a line for every image; - is the standard output")
      ->type_name("FILE");
  app.add_flag("--overlay", arguments.overlay, "draw matches_image, too");
  addBatchOptions(app, arguments.batch);
  addViewOptions(app, arguments.views);
  addMotionArguments(app, arguments.motion);
  addTargetsArguments(app, arguments.targets);
  tools::addCommonOptions(app, arguments.force);
  tools::addParameterOptions(app, arguments.parameters);
}

void refuseMissingNames(const Arguments& arguments) {
  if (!arguments.batch.list.empty()) {
    if (arguments.in.empty() || !arguments.out.empty()) {
      throw std::invalid_argument("--batch needs one name, that of the output folder");
    }
    return;
  }
  if (arguments.in.empty() || arguments.out.empty()) {
    throw std::invalid_argument((arguments.in.empty() ? "IN and OUT.bag are" : "OUT.bag is") +
                                std::string(" required; see --help"));
  }
}

int matchBatch(CLI::App& app, Arguments& arguments) {
  tools::stopWhenInterrupted();
  arguments.batch.folder = std::exchange(arguments.in, "");
  completeBatchOptions(app, arguments.parameters, arguments.batch);
  return runBatch(arguments.batch, [&](const std::string& input, const std::string& folder) {
    return matchInto(arguments, input, folder);
  });
}

int run(int argc, char** argv) {
  Arguments arguments;
  arguments.parameters.threads = 0;
  CLI::App app(
      "Matches the images of a recording as the nodelet would, but drops none and uses all cores.");
  addArguments(app, arguments);
  app.footer(std::string("The parameter threads is the number of images processed in parallel; "
                         "its default differs from that\nof the nodelet.\n\n") +
             tools::kExitCodes + "\nAfter 1 and 130, OUT.bag has the results up to that point.");
  if (const auto code = tools::parse(app, argc, argv)) return *code;
  refuseMissingNames(arguments);
  refuseIdleOptions(app, arguments.parameters);
  completeViewOptions(app, arguments.views, arguments.force);
  arguments.motion.force = arguments.force;
  arguments.targets.calibration = arguments.parameters.calibration;
  if (!arguments.batch.list.empty()) return matchBatch(app, arguments);
  return matchBag(arguments).exit_code;
}

}  // namespace
}  // namespace ktgp_orb

int main(int argc, char** argv) {
  return ktgp_orb::tools::runProgram("ktgp_bag", [&] { return ktgp_orb::run(argc, argv); });
}
