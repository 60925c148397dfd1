// ktgp_match A B: matches two images and prints the results of each of the four stages.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "files/csv.h"
#include "files/input.h"
#include "files/output_file.h"
#include "files/tiff_pages.h"
#include "homography/transform.h"
#include "ktgp_orb/metrics.h"
#include "ktgp_orb/overlay.h"
#include "ktgp_orb/pair_matcher.h"
#include "tools/matcher_cli.h"
#include "tools/pair_report.h"
#include "tools/program.h"
#include "two_view/fields.h"

namespace ktgp_orb::tools {
namespace {

using nlohmann::json;

constexpr const char* kDescription =
    "Matches image B (target) to image A (reference) with KTGP-ORB and prints what each stage\n"
    "keeps: nearest neighbours (knn), ratio filter (tf), motion statistics (gms), PROSAC "
    "(prosac).\n"
    "The homography maps pixels of A to pixels of B. Preset photo, the default, finds most.";

constexpr const char* kExamples =
    "Examples:\n"
    "  ktgp_match img1.ppm img2.ppm\n"
    "  ktgp_match img1.ppm img4.ppm --ground-truth H1to4p     errors against the known homography\n"
    "  ktgp_match a.png b.png --draw matches.png --csv matches.csv --json result.json\n"
    "  ktgp_match a.png b.png --preset ktgp                   the paper's chain, for frames of a "
    "video\n"
    "  ktgp_match a.png b.png --params tuned.yaml             what a node with these parameters "
    "does\n"
    "  ktgp_match a.png b.png --preset slam --camera 718.9,718.9,607.2,185.2   the camera's "
    "motion\n"
    "\n"
    "Exit code: 0 a homography, or the geometry that --geometry asks for, was found, 1 the images "
    "have none that can be trusted, 2 options,\n"
    "inputs or outputs cannot be used, 130 interrupted (Ctrl-C).";

struct Arguments {
  std::string reference;
  std::string target;
  std::string ground_truth;
  std::string json;
  std::string csv;
  std::string draw;
  std::string draw_stages;
  std::string draw_final;
  std::vector<double> camera;
  std::vector<double> target_camera;
  bool force = false;
  bool features_by_area = false;
  PipelineOptions pipeline;
};

Outcome run(Arguments& arguments) {
  ProgressBar progress(0);
  Outcome outcome;
  outcome.reference_file = arguments.reference;
  outcome.target_file = arguments.target;
  if (!arguments.ground_truth.empty())
    outcome.truth = files::readHomography(arguments.ground_truth);
  const cv::Mat reference = files::readGrey(arguments.reference);
  const cv::Mat target = files::readGrey(arguments.target);
  for (const std::string& file : {arguments.reference, arguments.target}) {
    const std::string note = files::noteOnPages(file);
    if (!note.empty()) std::fprintf(stderr, "ktgp_match: %s\n", note.c_str());
  }
  const PipelineOptions& options = arguments.pipeline;
  MatchHints hints;
  hints.reference_camera = cameraFrom(arguments.camera);
  hints.target_camera = cameraFrom(arguments.target_camera);
  progress.say("matching");
  outcome.pair = matchPair(reference, target,
                           {options.orb, options.matcher, arguments.features_by_area}, hints);
  arguments.pipeline.parameters.features = outcome.pair.max_features;
  outcome.hints = hints;

  std::vector<Correspondence> matches;
  for (std::size_t i = 0; i < outcome.distances.size(); ++i) {
    outcome.pair.match.surviving(static_cast<Level>(i), matches);
    outcome.distances[i] = metrics::descriptorDistance(matches);
    if (outcome.truth) {
      outcome.errors[i] = metrics::reprojectionErrors(*outcome.truth, outcome.pair.reference,
                                                      outcome.pair.target, matches);
    }
  }
  if (outcome.truth) {
    outcome.guided_errors = metrics::reprojectionErrors(
        *outcome.truth, outcome.pair.reference, outcome.pair.target, outcome.pair.match.guided);
  }
  return outcome;
}

/// A row of the table, with the columns that every match has. `level`: text for the column `level`.
files::CsvRow rowOf(const PairMatch& pair, const Correspondence& match, const char* level) {
  const auto r = static_cast<std::size_t>(match.reference_index);
  const auto t = static_cast<std::size_t>(match.target_index);
  const cv::Point2f& from = pair.reference.keypoints[r].pt;
  const cv::Point2f& to = pair.target.keypoints[t].pt;
  files::CsvRow row;
  row.add(r).add(t).add(from.x).add(from.y).add(to.x).add(to.y);
  row.add(match.distance).add(match.second_distance).add(match.ratio()).add(level);
  return row;
}

/// The matches as a csv table with one row for each nearest neighbour, and after them one row for
/// each guided match. The column `level` is the last stage that the match passed, or "guided".
std::string toCsv(const Outcome& outcome) {
  const char* const levels[] = {"knn", "kt", "ktg", "ktgp"};
  const std::vector<double>& errors = outcome.errors[0];
  const std::vector<Correspondence>& all = outcome.pair.match.correspondences;
  std::string out =
      "reference_index,target_index,reference_x,reference_y,target_x,target_y,"
      "distance,second_distance,ratio,level";
  if (outcome.truth) out += ",reprojection_error";
  const std::vector<ScenePoint> points = pointsOf(outcome);
  if (!points.empty()) out += ",x,y,z,distance_deviation";
  out += '\n';
  std::size_t i = 0;
  auto point = points.begin();
  for (std::size_t match = 0; match < all.size(); ++match) {
    const Correspondence& c = all[match];
    files::CsvRow row = rowOf(outcome.pair, c, levels[static_cast<std::size_t>(c.level)]);
    if (outcome.truth) row.add(errors[i++], 6);
    if (point != points.end() && outcome.pair.match.two_view.match[point->pair] == match) {
      for (int axis = 0; axis < 3; ++axis) row.add(point->position[axis]);
      row.add(two_view::distanceDeviation(*point++));
    } else if (!points.empty()) {
      row.skip(4);
    }
    out += row.line();
  }
  const std::vector<Correspondence>& guided = outcome.pair.match.guided;
  for (std::size_t k = 0; k < guided.size(); ++k) {
    files::CsvRow row = rowOf(outcome.pair, guided[k], "guided");
    if (outcome.truth) row.add(outcome.guided_errors[k], 6);
    if (!points.empty()) row.skip(4);
    out += row.line();
  }
  return out;
}

void writeFiles(const Arguments& arguments, const Outcome& outcome) {
  files::Outputs outputs(arguments.force);
  if (!arguments.json.empty()) {
    outputs.writeText(arguments.json, textOf(toJson(outcome, arguments.pipeline), 2));
  }
  if (!arguments.csv.empty()) outputs.writeText(arguments.csv, toCsv(outcome));
  if (arguments.draw.empty() && arguments.draw_stages.empty() && arguments.draw_final.empty()) {
    return outputs.commit();
  }
  const cv::Mat reference_image = files::readForView(arguments.reference);
  const cv::Mat target_image = files::readForView(arguments.target);
  const FrameView reference{reference_image, outcome.pair.reference};
  const FrameView target{target_image, outcome.pair.target};
  cv::Mat canvas;
  if (!arguments.draw.empty()) {
    drawOverlay(reference, target, outcome.pair.match, OverlayStyle::side_by_side, canvas);
    outputs.writeImage(arguments.draw, canvas);
  }
  if (!arguments.draw_stages.empty()) {
    drawStages(reference, target, outcome.pair.match, canvas);
    outputs.writeImage(arguments.draw_stages, canvas);
  }
  if (!arguments.draw_final.empty()) {
    drawLevel(reference, target, outcome.pair.match, Level::ktgp, canvas);
    outputs.writeImage(arguments.draw_final, canvas);
  }
  outputs.commit();
}

void addArguments(CLI::App& app, Arguments& arguments) {
  const auto file = [&](const char* name, std::string& value, const char* description) {
    return app.add_option(name, value, description)->type_name("FILE");
  };
  file("A", arguments.reference, "reference image")->required();
  file("B", arguments.target, "target image")->required();
  file("--ground-truth", arguments.ground_truth,
       "the true homography A -> B, nine numbers as text: adds errors to the table");
  file("--json", arguments.json, "write all results for the pair; - is the standard output");
  file("--csv", arguments.csv,
       "write a row per nearest neighbour, with the last stage it passed; - as above");
  file("--draw", arguments.draw,
       "write both images side by side: yellow = final match (green: of a scene with depth), "
       "purple = removed by PROSAC, blue = by GMS, grey = by the ratio filter");
  file("--draw-stages", arguments.draw_stages, "write a picture of the four stages");
  file("--draw-final", arguments.draw_final, "write a picture of the final matches alone");
  addCameraOption(
      app, "--camera", arguments.camera,
      "K of A without distortion, px, and of B, if it has the same size: with --geometry "
      "auto or epipolar, or --preset slam, for the camera's motion");
  addCameraOption(app, "--target-camera", arguments.target_camera, "K of B, where it differs")
      ->needs("--camera");
  addCommonOptions(app, arguments.force);
  const auto is_idle = [](const ParameterRow& row, const Parameters& /*all*/) {
    return row.name == "search_radius";  // a pair has no motion that predicts positions
  };
  addPipelineOptions(app, arguments.pipeline, is_idle, "photo");
}

int matchTwoImages(int argc, char** argv) {
  Arguments arguments;
  CLI::App app(kDescription);
  app.footer(kExamples);
  addArguments(app, arguments);
  if (const auto code = parse(app, argc, argv)) return *code;
  const bool photo = app.count("--preset") == 0 || app["--preset"]->as<std::string>() == "photo";
  const bool depth = arguments.pipeline.matcher.geometry != GeometryModel::homography;
  arguments.features_by_area =
      (photo || depth) && app.count("--params") + app.count("--features") == 0;

  if (!arguments.camera.empty() &&
      arguments.pipeline.matcher.geometry == GeometryModel::homography) {
    throw std::invalid_argument(
        "--camera is of use with --geometry auto or epipolar, or --preset slam; expected one of "
        "them");
  }
  files::OutputPlan plan = planOutputs(app, arguments.force);
  plan.write(arguments.json);
  plan.write(arguments.csv);
  for (const auto& file : {arguments.draw, arguments.draw_stages, arguments.draw_final}) {
    plan.writeImage(file);
  }
  exitWhenInterrupted();
  const Outcome outcome = run(arguments);
  const bool to_output =
      files::isStandardOutput(arguments.json) || files::isStandardOutput(arguments.csv);
  if (!to_output) print(outcome, arguments.pipeline);
  writeFiles(arguments, outcome);
  return outcome.pair.match.status == Status::ok ? kExitDone : kExitUnusedData;
}

}  // namespace
}  // namespace ktgp_orb::tools

int main(int argc, char** argv) {
  return ktgp_orb::tools::runProgram("ktgp_match",
                                     [&] { return ktgp_orb::tools::matchTwoImages(argc, argv); });
}
