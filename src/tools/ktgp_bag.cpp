// Matches the images of a bag without playing it: nothing is dropped, every core works, and the
// result is the nodelet's, message for message.

#include <unistd.h>

#include <algorithm>
#include <boost/filesystem.hpp>
#include <csignal>
#include <cstdio>
#include <iostream>
#include <opencv2/core/utility.hpp>
#include <thread>

#include "cli/matcher_cli.h"
#include "messages/image_conversion.h"
#include "messages/message_matcher.h"
#include "tools/bag_pipeline.h"
#include "tools/bag_reader.h"
#include "tools/bag_writer.h"

namespace ktgp_orb {
namespace {

constexpr int kExitDamaged = 2;        // the bag was damaged; what came before is in the output
constexpr int kExitInterrupted = 130;  // as a shell reports Ctrl-C

volatile std::sig_atomic_t interrupted = 0;

struct Arguments {
  std::string in;
  std::string out;
  std::string topic;
  std::string name;
  std::string csv;
  bool no_csv = false;
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

/// The part of the work that goes frame by frame.
class Run {
 public:
  Run(const Arguments& arguments, const Configuration& configuration, int threads)
      : source_(openBag(arguments.in, arguments.topic)),
        matcher_(configuration),
        pipeline_(configuration.sequence, fixedReference(configuration), configuration.stretch,
                  threads),
        writer_(arguments.out, arguments.csv, arguments.name),
        progress_(source_->total()) {}

  int run() {
    while (interrupted == 0) {
      auto recorded = source_->next();
      if (!recorded) break;
      if (recorded->image) pipeline_.push(recorded->image);
      waiting_.push_back(std::move(*recorded));
      if (pipeline_.full()) finishOldest();
    }
    while (!waiting_.empty()) finishOldest();
    writer_.close();
    if (interrupted != 0) return kExitInterrupted;
    return source_->damage().empty() ? 0 : kExitDamaged;
  }

  std::size_t images() const { return progress_.done(); }
  std::uint64_t refused() const { return refused_; }
  const std::string& damage() const { return source_->damage(); }

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
      ++refused_;
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

void completeNames(Arguments& arguments) {
  namespace fs = boost::filesystem;
  boost::system::error_code no_such_file;
  if (fs::equivalent(arguments.in, arguments.out, no_such_file)) {
    throw std::invalid_argument("OUT.bag is IN.bag; expected another file");
  }
  if (arguments.topic.empty() || arguments.topic[0] != '/') arguments.topic.insert(0, "/");
  if (arguments.name.empty()) {
    arguments.name = arguments.topic.substr(0, arguments.topic.rfind('/')) + "/matcher";
  }
  if (arguments.csv.empty() && !arguments.no_csv) {
    arguments.csv = fs::path(arguments.out).replace_extension(".csv").string();
  }
}

int matchBag(Arguments& arguments) {
  completeNames(arguments);
  cv::setNumThreads(1);  // the images themselves are spread over the cores
  Run run(arguments, configurationFor(arguments.parameters), threadsFrom(arguments.parameters));
  std::signal(SIGINT, [](int /*signal*/) { interrupted = 1; });
  std::signal(SIGTERM, [](int /*signal*/) { interrupted = 1; });
  const int code = run.run();
  std::cerr << (code == kExitInterrupted ? "interrupted: " : "") << run.images() << " images of "
            << arguments.topic << " matched, " << run.refused() << " of them refused; results in "
            << arguments.out << '\n';
  if (code == kExitDamaged) {
    std::cerr << "ktgp_bag: " << arguments.in << ": " << run.damage()
              << "\nThe images before that are matched; 'rosbag reindex' may repair the bag.\n";
  }
  return code;
}

int run(int argc, char** argv) {
  Arguments arguments;
  arguments.parameters.threads = 0;
  arguments.parameters.overlay = false;
  CLI::App app(
      "Matches the images of a bag as the nodelet would, but drops none and uses all cores.\n"
      "Exit code 2: IN.bag is damaged; OUT.bag holds what was before the damage.");
  app.add_option("IN.bag", arguments.in, "Bag to read")->required()->check(CLI::ExistingFile);
  app.add_option("OUT.bag", arguments.out, "Bag to write; replaced where it exists")->required();
  app.add_option("--topic", arguments.topic, "Image topic in IN.bag, raw or compressed")
      ->required();
  app.add_option("--name", arguments.name,
                 "Namespace of the output topics; without it: matcher beside the image topic");
  app.add_option("--csv", arguments.csv, "Table with a line for every image; without it: OUT.csv");
  app.add_flag("--no_csv", arguments.no_csv, "Write no table");
  tools::addParameterOptions(app, arguments.parameters);
  app.footer(
      "Of the parameters, threads is the number of images worked on at a time, and overlay\n"
      "stands for a subscriber of matches_image; both defaults differ from the nodelet's.");
  if (const auto code = tools::parse(app, argc, argv)) return *code;
  return matchBag(arguments);
}

}  // namespace
}  // namespace ktgp_orb

int main(int argc, char** argv) {
  try {
    return ktgp_orb::run(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "ktgp_bag: %s\n", error.what());
    return 1;
  }
}
