// Matches the images of a bag without playing it: nothing is dropped, every core works, and the
// result is the nodelet's, message for message.

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <iostream>
#include <opencv2/core/utility.hpp>
#include <thread>

#include "bag/reader.h"
#include "cli/matcher_cli.h"
#include "cli/output_file.h"
#include "cli/program.h"
#include "messages/image_conversion.h"
#include "messages/message_matcher.h"
#include "tools/bag_pipeline.h"
#include "tools/bag_writer.h"

namespace ktgp_orb {
namespace {

struct Arguments {
  std::string in;
  std::string out;
  BagSelection selection;
  std::string name;
  std::string csv;
  bool force = false;
  Parameters parameters;
};

/// Prints how far it got, on a terminal only.
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

/// Namespace of the output: beside the image topic, as the nodelet has it, which is given a topic
/// without the suffix of its transport.
std::string outputNames(const std::string& name, std::string topic) {
  if (!name.empty()) return name;
  const std::string suffix = "/compressed";
  const std::size_t end = topic.size() - std::min(topic.size(), suffix.size());
  if (topic.compare(end, std::string::npos, suffix) == 0) topic.erase(end);
  return topic.substr(0, topic.rfind('/')) + "/matcher";
}

/// The part of the work that goes frame by frame.
class Run {
 public:
  Run(const Arguments& arguments, const Configuration& configuration, int threads)
      : source_(openBag(arguments.in, arguments.selection)),
        matcher_(configuration),
        pipeline_(configuration.sequence, fixedReference(configuration), configuration.stretch,
                  threads),
        writer_(arguments.out, arguments.csv, outputNames(arguments.name, source_->topic())),
        progress_(source_->total()) {}

  int run() {
    while (!tools::interrupted()) {
      auto recorded = source_->next();
      if (!recorded) break;
      if (recorded->image) pipeline_.push(recorded->image);
      waiting_.push_back(std::move(*recorded));
      if (pipeline_.full()) finishOldest();
    }
    while (!waiting_.empty()) finishOldest();
    writer_.close();
    if (tools::interrupted()) return tools::kExitInterrupted;
    return source_->damage().empty() && refused_ == 0 ? tools::kExitDone : tools::kExitUnusedData;
  }

  std::size_t images() const { return progress_.done(); }
  std::uint64_t refused() const { return refused_; }
  /// Why the first of them was.
  const std::string& refusal() const { return refusal_; }
  const std::string& topic() const { return source_->topic(); }
  std::string damage() const { return source_->damage(); }

 private:
  FrameConstPtr fixedReference(const Configuration& configuration) const {
    const bool fixed = configuration.sequence.reference.mode == ReferenceMode::fixed;
    return fixed ? matcher_.fixedReference() : nullptr;
  }

  void finishOldest() {
    const RecordedImage recorded = std::move(waiting_.front());
    waiting_.pop_front();
    try {
      finish(recorded);
    } catch (const RefusedImage& error) {
      if (refused_++ == 0) refusal_ = error.what();
      std_msgs::Header header;
      header.stamp = recorded.received;
      writer_.writeRefused(recorded.image ? recorded.image->header : header, error.what());
    }
    progress_.advance();
  }

  void finish(const RecordedImage& recorded) {
    if (!recorded.image) throw RefusedImage("compressed image cannot be decoded");
    FramePipeline::Prepared prepared = pipeline_.pop();
    FrameMessages messages = matcher_.process(recorded.image->header, prepared.frame,
                                              prepared.ahead ? &*prepared.ahead : nullptr);
    if (matcher_.configuration().overlay) messages.overlay = matcher_.overlay();
    messages.statistics->refused_frames = refused_;
    writer_.write(messages, recorded.received);
  }

  std::unique_ptr<ImageSource> source_;
  MessageMatcher matcher_;
  FramePipeline pipeline_;
  MatchWriter writer_;
  Progress progress_;
  std::deque<RecordedImage> waiting_;  // in the pipeline
  std::uint64_t refused_ = 0;
  std::string refusal_;
};

int threadsFrom(const Parameters& parameters) {
  if (parameters.threads > 0) return parameters.threads;
  return static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
}

Configuration configurationFor(Parameters parameters) {
  parameters.threads = 1;  // for one image; several are worked on at a time
  Configuration configuration = configurationFrom(parameters, 0);
  configuration.reference_image = readImageFile(parameters.reference_image);
  return configuration;
}

void checkFiles(Arguments& arguments) {
  tools::OutputPlan plan(arguments.force);
  plan.read(arguments.in);
  plan.read(arguments.parameters.reference_image);
  plan.write(arguments.out);
  plan.write(arguments.csv);
}

int matchBag(Arguments& arguments) {
  std::string& topic = arguments.selection.topic;
  if (!topic.empty() && topic[0] != '/') topic.insert(0, "/");
  checkFiles(arguments);
  cv::setNumThreads(1);  // the images themselves are spread over the cores
  Run run(arguments, configurationFor(arguments.parameters), threadsFrom(arguments.parameters));
  tools::stopWhenInterrupted();
  const int code = run.run();
  std::cerr << (code == tools::kExitInterrupted ? "interrupted: " : "") << run.images()
            << " images of " << run.topic() << " matched, " << run.refused()
            << " of them refused; results in " << arguments.out << '\n';
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

void addArguments(CLI::App& app, Arguments& arguments) {
  app.add_option("IN.bag", arguments.in, "bag to read")->required()->check(CLI::ExistingFile);
  app.add_option("OUT.bag", arguments.out, "bag to write")->required();
  app.add_option("--topic", arguments.selection.topic,
                 "image topic in IN.bag, raw or compressed; not needed where there is one only");
  app.add_option("--start", arguments.selection.start, "begin this long after the bag does [s]")
      ->check(tools::numberIn("[0, 1000000000]"));
  app.add_option("--duration", arguments.selection.duration, "use only this much of it [s]")
      ->check(tools::numberIn("[0, 1000000000]"));
  app.add_option("--name", arguments.name,
                 "namespace of the output topics; without it: matcher beside the image topic");
  app.add_option("--csv", arguments.csv, "write a table with a line for every image")
      ->type_name("FILE");
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
  app.footer(
      std::string("Of the parameters, threads is the number of images worked on at a time, and "
                  "overlay\nstands for a subscriber of matches_image; both defaults differ from "
                  "the nodelet's.\n\n") +
      tools::kExitCodes + "\nAfter 1 and 130 OUT.bag holds what could be used until then.");
  if (const auto code = tools::parse(app, argc, argv)) return *code;
  return matchBag(arguments);
}

}  // namespace
}  // namespace ktgp_orb

int main(int argc, char** argv) {
  return ktgp_orb::tools::runProgram("ktgp_bag", [&] { return ktgp_orb::run(argc, argv); });
}
