// ktgp_evaluate_bag: evaluates the four stages on consecutive frames of a recording.
#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <opencv2/core/utility.hpp>
#include <stdexcept>

#include "evaluation/bag_frames.h"
#include "evaluation/sequence_evaluation.h"
#include "files/output_file.h"
#include "ktgp_orb/metrics.h"
#include "tools/matcher_cli.h"
#include "tools/program.h"

namespace ktgp_orb::evaluation {
namespace {

constexpr const char* kDescription =
    "Matches each frame of a recording to the previous one and prints how many homographies are\n"
    "found, "
    "how long tracks survive and, if the recording has the truth, how large the errors are.";

struct Arguments {
  std::string bag;
  std::string topic = "/camera/image_raw";
  std::string truth_topic = "/camera/ground_truth/homography";
  int drift_window = 30;
  std::string json;
  bool force = false;
  PipelineOptions pipeline;
};

/// `window`: see SequenceEvaluator.
void printSequence(const SequenceScore& score, int window) {
  std::size_t found = 0;
  double ratio = 0.0;
  std::vector<double> errors;
  std::vector<double> drift;
  double inliers = 0.0;
  std::vector<double> milliseconds;
  std::size_t near = 0;
  std::size_t fell_back = 0;
  for (const FrameScore& frame : score.frames) {
    inliers += static_cast<double>(frame.matches[3]);
    milliseconds.push_back(frame.milliseconds);
    if (frame.search == Search::near) ++near;
    if (frame.search == Search::fell_back) ++fell_back;
    if (frame.status == Status::ok) ++found;
    ratio += frame.inlier_ratio;
    if (frame.corner_error) errors.push_back(*frame.corner_error);
    if (frame.drift) drift.push_back(*frame.drift);
  }
  const auto pairs = static_cast<double>(std::max<std::size_t>(1, score.frames.size() - 1));
  std::printf("%zu frames, homography for %zu, mean inlier ratio %.1f%%, mean inliers %.1f\n",
              score.frames.size(), found, 100.0 * ratio / pairs, inliers / pairs);
  std::printf("median %.2f ms a frame; searched near the prediction: %zu, and fell back: %zu\n",
              metrics::median(milliseconds), near, fell_back);
  for (std::size_t k : {2, 5, 10, 30}) {
    if (k > score.survival.size()) break;
    std::printf("tracks that survive %2zu frames: %5.1f%%\n", k, 100.0 * score.survival[k - 1]);
  }
  if (errors.empty()) return;
  std::printf(
      "corner error from frame to frame: %.3f px; mean drift after 1 to %zu frames: %.2f px\n",
      metrics::summarize(errors).mean,
      window > 0 ? static_cast<std::size_t>(window) : errors.size(),
      metrics::summarize(drift).mean);
}

/// `needs_truth`: the option --truth-topic is given.
int evaluateBag(const Arguments& arguments, bool needs_truth) {
  SequenceEvaluator evaluator(arguments.pipeline.orb, arguments.pipeline.matcher,
                              arguments.drift_window);
  tools::ProgressBar progress(0);
  bool has_truth = false;
  const std::string damage =
      readBag(arguments.bag, arguments.topic, arguments.truth_topic,
              [&](double stamp, const cv::Mat& image, const std::optional<Eigen::Matrix3d>& truth) {
                evaluator.addFrame(stamp, image, truth);
                has_truth |= truth.has_value();
                progress.advance("frames of " + arguments.bag);
              });
  const SequenceScore score = evaluator.score();
  if (!files::isStandardOutput(arguments.json)) printSequence(score, arguments.drift_window);
  if (!arguments.json.empty()) {
    const nlohmann::json out{{"sequence", toJson(score)},
                             {"bag", arguments.bag},
                             {"topic", arguments.topic},
                             {"drift_window", arguments.drift_window},
                             {"options", tools::toJson(arguments.pipeline)}};
    files::writeText(arguments.json, tools::textOf(out, 1), arguments.force);
  }
  const bool misses_truth = needs_truth && !has_truth;
  if (misses_truth) {
    std::fprintf(stderr,
                 "ktgp_evaluate_bag: %s has no homography (ktgp_orb/HomographyStamped) between two "
                 "successive images of %s on %s, so that no error is known\n",
                 arguments.bag.c_str(), arguments.topic.c_str(), arguments.truth_topic.c_str());
  }
  if (damage.empty()) return misses_truth ? tools::kExitUnusedData : tools::kExitDone;
  std::fprintf(stderr, "ktgp_evaluate_bag: %s: %s\n", arguments.bag.c_str(), damage.c_str());
  return tools::kExitUnusedData;
}

void addArguments(CLI::App& app, Arguments& arguments) {
  app.add_option("BAG", arguments.bag, "recording")->required()->check(CLI::ExistingFile);
  app.add_option("--topic", arguments.topic, "its images")->capture_default_str();
  app.add_option("--truth-topic", arguments.truth_topic,
                 "true homographies from frame to frame (ktgp_orb/HomographyStamped), where known")
      ->capture_default_str();
  app.add_option("--drift-window", arguments.drift_window,
                 "most frames over which homographies are multiplied, 0 = all")
      ->check(tools::wholeNumberIn(0, 1000000))
      ->capture_default_str();
  app.add_option("--json", arguments.json, "write a row per frame; - is the standard output")
      ->type_name("FILE");
  tools::addCommonOptions(app, arguments.force);
  const auto is_idle = [](const ParameterRow& row, const Parameters& /*all*/) {
    // Each frame is matched to the previous one, where growth is off.
    return row.name == "growth" || row.name == "views";
  };
  tools::addPipelineOptions(app, arguments.pipeline, is_idle);
}

int run(int argc, char** argv) {
  Arguments arguments;
  CLI::App app(kDescription);
  app.footer(tools::kExitCodes);
  addArguments(app, arguments);
  if (const auto code = tools::parse(app, argc, argv)) return *code;
  if (arguments.pipeline.parameters.reference_mode == "fixed") {
    throw std::invalid_argument(
        "reference_mode is fixed, but each frame is matched to the previous one; expected "
        "parameters without it, or ktgp_bag");
  }
  tools::planOutputs(app, arguments.force).write(arguments.json);
  tools::exitWhenInterrupted();
  cv::setNumThreads(1);
  return evaluateBag(arguments, app.count("--truth-topic") > 0);
}

}  // namespace
}  // namespace ktgp_orb::evaluation

int main(int argc, char** argv) {
  return ktgp_orb::tools::runProgram("ktgp_evaluate_bag",
                                     [&] { return ktgp_orb::evaluation::run(argc, argv); });
}
