// Matches the images of a bag without playing it: uses all cores, drops no image, and gives the
// same messages as the nodelet.

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <iostream>
#include <map>
#include <opencv2/core/utility.hpp>
#include <thread>
#include <utility>

#include "bag/reader.h"
#include "cli/matcher_cli.h"
#include "cli/output_file.h"
#include "cli/program.h"
#include "messages/camera.h"
#include "messages/image_conversion.h"
#include "messages/message_matcher.h"
#include "messages/rate_limiter.h"
#include "tools/bag_motion.h"
#include "tools/bag_pipeline.h"
#include "tools/bag_views.h"
#include "tools/bag_writer.h"

namespace ktgp_orb {
namespace {

struct Arguments {
  std::string in;
  std::string out;
  BagSelection selection;
  std::string name;
  std::string csv;
  ViewOptions views;
  MotionFile motion;
  bool force = false;
  Parameters parameters;
};

/// Prints the progress, only on a terminal.
class Progress {
 public:
  explicit Progress(std::size_t total) : total_(total), shown_(isatty(STDERR_FILENO) != 0) {}
  ~Progress() {
    if (shown_) std::fputc('\n', stderr);
  }

  void advance() {
    ++done_;
    if (!shown_) return;
    constexpr std::size_t kWidth = 40;
    const std::size_t filled = total_ > 0 ? std::min(kWidth, kWidth * done_ / total_) : 0;
    const std::string bar = std::string(filled, '#') + std::string(kWidth - filled, '.');
    std::fprintf(stderr, "\r[%s] %zu", bar.c_str(), done_);
    if (total_ > 0) std::fprintf(stderr, "/%zu images", total_);
  }

  std::size_t done() const { return done_; }

 private:
  std::size_t total_;
  std::size_t done_ = 0;
  bool shown_;
};

/// Namespace of the output: beside the image topic, as for the nodelet.
std::string outputNames(const std::string& name, const std::string& topic) {
  return name.empty() ? cameraOf(topic) + "/matcher" : name;
}

/// The sequential part of the work, frame by frame.
class Run {
 public:
  Run(const Arguments& arguments, std::unique_ptr<ImageSource> source,
      const Configuration& configuration, int threads)
      : source_(std::move(source)),
        matcher_(configuration),
        pipeline_(configuration, fixedReference(configuration), threads),
        writer_(arguments.out, arguments.csv, outputNames(arguments.name, source_->topic()),
                arguments.force),
        views_(arguments.views),
        motion_(arguments.motion, arguments.in, source_->topic()),
        progress_(source_->total()) {
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
  std::uint64_t skipped() const { return skipped_; }
  std::uint64_t refused() const { return refused_; }
  /// The reason for the first of them.
  const std::string& refusal() const { return refusal_; }
  const std::string& topic() const { return source_->topic(); }
  std::string viewReport() const { return views_.report() + motion_.report(); }
  std::string damage() const { return source_->damage(); }

 private:
  FrameConstPtr fixedReference(const Configuration& configuration) const {
    const bool fixed = configuration.sequence.reference.mode == ReferenceMode::fixed;
    return fixed ? matcher_.fixedReference() : nullptr;
  }

  bool isSkipped(const RecordedImage& recorded) {
    if (!recorded.image || rate_limiter_.takes(recorded.image->header.stamp)) return false;
    ++skipped_;
    progress_.advance();
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
    progress_.advance();
  }

  void finish(const RecordedImage& recorded, std::uint64_t skipped) {
    if (!recorded.image) throw RefusedImage("compressed image cannot be decoded");
    FramePipeline::Prepared prepared = pipeline_.pop();
    FrameMessages messages = matcher_.process(recorded.image->header, prepared.frame,
                                              prepared.ahead ? &*prepared.ahead : nullptr);
    if (matcher_.configuration().overlay) messages.overlay = matcher_.overlay();
    messages.statistics->refused_frames = refused_;
    messages.statistics->skipped_frames = skipped;
    writer_.write(messages, recorded.received);
    ++matched_;
    views_.add(recorded.image, *messages.homography);
    motion_.add(*messages.homography, cv::Size(static_cast<int>(recorded.image->width),
                                               static_cast<int>(recorded.image->height)));
  }

  std::unique_ptr<ImageSource> source_;
  MessageMatcher matcher_;
  FramePipeline pipeline_;
  MatchWriter writer_;
  BagViews views_;
  BagMotion motion_;
  Progress progress_;
  RateLimiter rate_limiter_;
  std::size_t matched_ = 0;
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
  if (parameters.rectify) configuration.view.lens = lensFrom(readCameraInfo(bag, topic));
  return configuration;
}

void checkFiles(Arguments& arguments) {
  tools::OutputPlan plan(arguments.force);
  plan.read(arguments.in);
  plan.read(arguments.parameters.reference_image);
  plan.read(arguments.parameters.mask_image);
  plan.write(arguments.out);
  plan.write(arguments.csv);
  plan.writeVideo(arguments.views.stabilized);
  plan.write(arguments.views.warps);
  plan.writeImage(arguments.views.mosaic);
  // The number of maps is not known beforehand; old files are checked.
  if (!arguments.views.mosaic.empty()) plan.writeImage(mosaicOf(arguments.views.mosaic, 2));
  plan.write(arguments.views.mosaic_poses);
  plan.write(arguments.motion.path);
}

int matchBag(Arguments& arguments) {
  std::string& topic = arguments.selection.topic;
  if (!topic.empty() && topic[0] != '/') topic.insert(0, "/");
  tools::stopWhenInterrupted();
  checkFiles(arguments);
  cv::setNumThreads(1);  // the images are distributed over the cores
  auto source = openBag(arguments.in, arguments.selection);
  const Configuration configuration =
      configurationFor(arguments.parameters, arguments.in, source->topic());
  Run run(arguments, std::move(source), configuration, threadsFrom(arguments.parameters));
  const int code = run.run();
  std::cerr << (code == tools::kExitInterrupted ? "interrupted: " : "") << run.matched()
            << " images of " << run.topic() << " matched, " << run.refused() << " refused, "
            << run.skipped() << " skipped by max_rate; results in " << arguments.out << '\n'
            << run.viewReport();
  if (run.refused() > 0) {
    std::cerr << "ktgp_bag: " << arguments.in << ": " << run.refused()
              << " images could not be used, the first because: " << run.refusal() << '\n';
  }
  if (!run.damage().empty()) {
    std::cerr << "ktgp_bag: " << arguments.in << ": " << run.damage()
              << "\nWhat could be read is matched; 'rosbag reindex' may repair the bag.\n";
  }
  return code;
}

void addViewArguments(CLI::App& app, ViewOptions& views) {
  const char* const group = "To look at";
  CLI::Option* const video =
      app.add_option("--stabilize", views.stabilized, "write a steady video (mp4) of the images")
          ->type_name("FILE")
          ->group(group);
  app.add_option("--stabilizer_strength", views.stabilizer.strength,
                 "faster motion is shake and is removed [s]")
      ->check(tools::numberIn(limitsOf("stabilizer", "strength")))
      ->capture_default_str()
      ->needs(video)
      ->group(group);
  app.add_option("--stabilizer_lag", views.stabilizer.lag, "later frames to wait for")
      ->check(tools::numberIn(limitsOf("stabilizer", "lag")))
      ->capture_default_str()
      ->needs(video)
      ->group(group);
  app.add_option("--stabilizer_max_crop", views.stabilizer.max_crop,
                 "share of width and height to cut off at each border")
      ->check(tools::numberIn(limitsOf("stabilizer", "max_crop")))
      ->capture_default_str()
      ->needs(video)
      ->group(group);
  app.add_option("--stabilizer_warps", views.warps,
                 "write a table with the image -> steady image homography of every image; needs "
                 "--stabilize")
      ->type_name("FILE")
      ->needs(video)
      ->group(group);
  CLI::Option* const map =
      app.add_option(
             "--mosaic", views.mosaic,
             "write the mosaic as a picture (png); further maps, after a cut for example, are in "
             "FILE-2 and so on")
          ->type_name("FILE")
          ->group(group);
  app.add_option("--mosaic_keyframes", views.map.keyframes,
                 "place frames by matches to keyframes; false: by the homographies alone")
      ->capture_default_str()
      ->needs(map)
      ->group(group);
  app.add_option("--mosaic_max_megapixels", views.map.max_megapixels,
                 "size at which the map stops growing")
      ->check(tools::numberIn(limitsOf("mosaic", "max_megapixels")))
      ->capture_default_str()
      ->needs(map)
      ->group(group);
  app.add_option("--mosaic_poses", views.mosaic_poses,
                 "write a table with the map -> frame homography of every image; needs --mosaic")
      ->type_name("FILE")
      ->needs(map)
      ->group(group);
}

/// Options that would be accepted without effect.
void refuseIdleOptions(const CLI::App& app, const Parameters& parameters) {
  const std::string pose = "ktgp_bag writes no pose; the node publishes it";
  const std::string diagnostics = "it is for the diagnostics of the node";
  std::map<std::string, std::string> idle{
      {"target_width", pose},
      {"target_frame", pose},
      {"calibration", pose},
      {"lazy", "ktgp_bag matches every image"},
      {"min_input_rate", diagnostics},
      {"max_drop_ratio", diagnostics},
      {"max_lost_ratio", diagnostics},
      {"max_latency", diagnostics},
      {"min_ok_ratio", diagnostics},
      {"error_factor", diagnostics},
      {"max_pair_megapixels", "it is for the service match_pair of the node"}};
  if (parameters.reference_mode != "fixed" && !parameters.reference_image.empty()) {
    idle["reference_image"] = "it is used only with --reference_mode fixed";
  }
  if (parameters.reference_mode != "keyframe") {
    for (const char* name : {"keyframe_min_overlap", "keyframe_min_inliers"}) {
      idle[name] = "it is used only with --reference_mode keyframe";
    }
  }
  if (!parameters.overlay) idle["overlay_style"] = "it is used only with --overlay";
  for (const auto& [name, reason] : idle) {
    if (app.get_option("--" + name)->count() == 0) continue;
    std::string text = "--" + name;
    text.append(" has no effect: ").append(reason).append("; leave it out");
    throw std::invalid_argument(text);
  }
  if (parameters.reference_mode == "fixed" && parameters.reference_image.empty()) {
    throw std::invalid_argument(
        "reference_mode is fixed, and there is no reference; expected --reference_image FILE");
  }
}

void addArguments(CLI::App& app, Arguments& arguments) {
  app.add_option("IN.bag", arguments.in, "bag to read")->required()->check(CLI::ExistingFile);
  app.add_option("OUT.bag", arguments.out, "bag to write")->required();
  app.add_option("--topic", arguments.selection.topic,
                 "image topic in IN.bag, raw or compressed; not needed if there is only one");
  app.add_option("--start", arguments.selection.start,
                 "start this long after the start of the bag [s]")
      ->check(tools::numberIn({0.0, 1e9}));
  app.add_option("--duration", arguments.selection.duration, "length of the part to use [s]")
      ->check(tools::numberIn({0.0, 1e9}));
  app.add_option("--name", arguments.name,
                 "namespace of the output topics; without it: matcher beside the image topic");
  app.add_option("--csv", arguments.csv, "write a table with a line for every image")
      ->type_name("FILE");
  addViewArguments(app, arguments.views);
  addMotionArguments(app, arguments.motion);
  tools::addCommonOptions(app, arguments.force);
  tools::addParameterOptions(app, arguments.parameters);
}

int run(int argc, char** argv) {
  Arguments arguments;
  arguments.parameters.threads = 0;
  arguments.parameters.overlay = false;
  CLI::App app(
      "Matches the images of a bag as the nodelet would, but drops none and uses all cores.");
  addArguments(app, arguments);
  app.footer(std::string("The parameter threads is the number of images processed in parallel, and "
                         "overlay\ndraws matches_image; both defaults differ from those of the "
                         "nodelet.\n\n") +
             tools::kExitCodes + "\nAfter 1 and 130, OUT.bag has the results up to that point.");
  if (const auto code = tools::parse(app, argc, argv)) return *code;
  refuseIdleOptions(app, arguments.parameters);
  arguments.views.force = arguments.motion.force = arguments.force;
  return matchBag(arguments);
}

}  // namespace
}  // namespace ktgp_orb

int main(int argc, char** argv) {
  return ktgp_orb::tools::runProgram("ktgp_bag", [&] { return ktgp_orb::run(argc, argv); });
}
