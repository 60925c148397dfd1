// ktgp_evaluate_targets FOLDER: counts the flat targets that are found in labelled photographs and
// videos. scripts/evaluate --targets runs this program.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <opencv2/core/utility.hpp>
#include <string>

#include "evaluation/target_frames.h"
#include "tools/matcher_cli.h"
#include "tools/program.h"

namespace ktgp_orb::evaluation {
namespace {

int evaluateTargets(int argc, char** argv) {
  std::string folder;
  TargetFinderOptions options;
  CLI::App app(
      "Searches the targets of FOLDER/labels.json in its photographs and videos, and prints how\n"
      "many are found; see doc/targets.md.");
  app.add_option("--targets,FOLDER", folder, "folder of labels.json")->required();
  app.add_option("--smallest-side", options.smallest_side, "of a target in the image [px]")
      ->capture_default_str();
  app.add_option("--features", options.orb.max_features, "most keypoints of an image")
      ->capture_default_str();
  if (const auto code = tools::parse(app, argc, argv)) return *code;
  cv::setNumThreads(1);
  tools::exitWhenInterrupted();
  const LabelledTargets searched = searchLabelled(folder, options);
  std::fputs(toTable(searched).c_str(), stdout);
  for (const std::string& problem : searched.problems) {
    std::fprintf(stderr, "ktgp_evaluate_targets: %s\n", problem.c_str());
  }
  return searched.problems.empty() ? tools::kExitDone : tools::kExitUnusedData;
}

}  // namespace
}  // namespace ktgp_orb::evaluation

int main(int argc, char** argv) {
  return ktgp_orb::tools::runProgram(
      "ktgp_evaluate_targets", [&] { return ktgp_orb::evaluation::evaluateTargets(argc, argv); });
}
