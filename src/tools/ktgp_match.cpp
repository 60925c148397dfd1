// ktgp_match A B: matches two images and prints what each of the four stages kept.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "files/csv.h"
#include "files/input.h"
#include "files/output_file.h"
#include "homography/transform.h"
#include "ktgp_orb/metrics.h"
#include "ktgp_orb/overlay.h"
#include "ktgp_orb/sequence_matcher.h"
#include "tools/matcher_cli.h"
#include "tools/program.h"
#include "two_view/cameras.h"

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

/// A larger standard deviation of a corner, px, deserves a warning: a match counts as right within
/// it.
constexpr double kUncertainCorner = 3.0;

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
  bool force = false;
  bool features_by_area = false;
  PipelineOptions pipeline;
};

struct Outcome {
  Frame reference;
  Frame target;
  MatchResult result;
  // Of the matches left after each of the four stages:
  std::array<metrics::ErrorSummary, 4> distances;  ///< of the descriptors
  std::array<std::vector<double>, 4> errors;       ///< against the truth, px; empty without one
  std::optional<Eigen::Matrix3d> truth;
};

/// Preset photo's keypoints are for up to a megapixel; larger images have more details to tell
/// apart.
int featuresFor(double pixels, int up_to_a_megapixel) {
  constexpr double kMost = 8000.0;
  return static_cast<int>(std::min(kMost, up_to_a_megapixel * std::max(1.0, 1e-6 * pixels)));
}

/// Simulated views take longer than all the rest, so they come where the growth finds nothing
/// without them.
void match(const Arguments& arguments, ProgressBar& progress, Outcome& outcome) {
  const PipelineOptions& options = arguments.pipeline;
  const std::vector<double>& camera = arguments.camera;
  KtgpMatcher matcher(options.matcher);
  MatchHints hints;
  if (!camera.empty()) {
    hints.reference_camera.emplace();
    *hints.reference_camera << camera[0], 0.0, camera[2], 0.0, camera[1], camera[3], 0.0, 0.0, 1.0;
  }
  const Features& reference = outcome.reference.features;
  progress.say("matching");
  matcher.match(reference, outcome.target.features, hints, outcome.result);
  const GrowthOptions& growth = options.matcher.growth;
  if (outcome.result.found() == Status::ok || !growth.enabled || growth.views == 0) return;
  progress.say("matching with simulated views of " + arguments.reference);
  const ReferenceViews views = simulateViews(outcome.reference.image, options.orb, growth.views);
  hints.views = &views;
  matcher.match(reference, outcome.target.features, hints, outcome.result);
}

Outcome run(Arguments& arguments) {
  ProgressBar progress(0);
  Outcome outcome;
  if (!arguments.ground_truth.empty())
    outcome.truth = files::readHomography(arguments.ground_truth);
  outcome.reference.image = files::readGrey(arguments.reference);
  outcome.target.image = files::readGrey(arguments.target);
  if (arguments.features_by_area) {
    const double pixels = static_cast<double>(
        std::max(outcome.reference.image.total(), outcome.target.image.total()));
    int& features = arguments.pipeline.parameters.features;
    features = featuresFor(pixels, features);
    arguments.pipeline.orb.max_features = features;
  }
  OrbExtractor extractor(arguments.pipeline.orb);
  progress.say("finding features of " + arguments.reference);
  extractFeatures(extractor, outcome.reference);
  progress.say("finding features of " + arguments.target);
  extractFeatures(extractor, outcome.target);
  match(arguments, progress, outcome);

  std::vector<Correspondence> matches;
  for (std::size_t i = 0; i < outcome.distances.size(); ++i) {
    outcome.result.surviving(static_cast<Level>(i), matches);
    outcome.distances[i] = metrics::descriptorDistance(matches);
    if (outcome.truth) {
      outcome.errors[i] = metrics::reprojectionErrors(*outcome.truth, outcome.reference.features,
                                                      outcome.target.features, matches);
    }
  }
  return outcome;
}

void printFrame(const char* role, const std::string& file, const Frame& frame) {
  std::printf("%-9s  %s, %dx%d px, %zu keypoints in %.1f ms\n", role, file.c_str(),
              frame.image.cols, frame.image.rows, frame.features.size(),
              frame.extraction_milliseconds);
}

/// What followed the four stages.
std::vector<StageResult> refinementsOf(const Outcome& outcome) {
  const std::vector<StageResult>& all = outcome.result.stages;
  return {all.begin() + outcome.distances.size(), all.end()};
}

void printStages(const Outcome& outcome) {
  std::printf("\nstage    input  output   kept       ms  distance mean    rms");
  if (outcome.truth) std::printf("  within 3 px  error mean      rms");
  std::printf("\n");
  for (std::size_t i = 0; i < outcome.distances.size(); ++i) {
    const StageResult& s = outcome.result.stages[i];
    std::printf("%-7s %6zu  %6zu %5.1f%% %8.2f  %13.3f %6.3f", s.name, s.input, s.output,
                100.0 * metrics::retention(s.output, s.input), s.milliseconds,
                outcome.distances[i].mean, outcome.distances[i].rms);
    if (outcome.truth) {
      const metrics::ErrorSummary error = metrics::summarize(outcome.errors[i]);
      std::printf("  %10.1f%%  %7.2f px  %7.2f",
                  100.0 * metrics::precision(outcome.errors[i], metrics::kCorrectWithin),
                  error.mean, error.rms);
    }
    std::printf("\n");
  }
  for (const StageResult& s : refinementsOf(outcome)) {
    std::printf("%-7s %6zu  %6zu %6s %8.2f\n", s.name, s.input, s.output, "", s.milliseconds);
  }
}

/// The largest standard deviation of a corner of A in B, px.
double cornerDeviation(const Outcome& outcome) {
  return homography::cornerDeviation(outcome.result.answer.homography,
                                     outcome.result.answer.covariance,
                                     homography::imageCorners(outcome.reference.image.size(), {}))
      .target;
}

/// What to try where nothing was found, and why.
std::string advice(const Outcome& outcome, const PipelineOptions& options) {
  const MatcherOptions& matcher = options.matcher;
  if (outcome.result.status == Status::too_few_features) {
    return "an image has hardly any corners: is it sharp, bright and textured? A lower "
           "--fast_threshold finds weaker ones";
  }
  const cv::Size a = outcome.reference.image.size();
  const cv::Size b = outcome.target.image.size();
  const std::string size = noteOnSize(std::max({a.width, a.height, b.width, b.height}));
  const std::string more = size.empty() ? "" : "; " + size;
  if (!matcher.growth.enabled || matcher.growth.views == 0 ||
      options.orb.descriptor != DescriptorKind::teblid) {
    return "these settings are for neighbouring frames of a video; --preset photo finds more "
           "where the views differ" +
           more;
  }
  return "no plane that both images show was recognised. If they do show one: --features 20000 for "
         "small details, or cut both images to the common part" +
         more;
}

void printMatrix(const Eigen::Matrix3d& m) {
  for (int row = 0; row < 3; ++row) {
    std::printf("  %15.8g %15.8g %15.8g\n", m(row, 0), m(row, 1), m(row, 2));
  }
}

/// The motion, unless there is none; `text` says which.
void printPose(const char* text, const RelativePose& pose) {
  std::printf("%s: rotation | translation\n", text);
  for (int row = 0; row < 3; ++row) {
    std::printf("  %12.8f %12.8f %12.8f | %12.8f\n", pose.rotation(row, 0), pose.rotation(row, 1),
                pose.rotation(row, 2), pose.translation[row]);
  }
}

void printTwoView(const MatchResult& result) {
  const TwoView& view = result.two_view.view;
  if (result.stage("two_view") == nullptr || result.geometry == Geometry::none) return;
  std::printf("\ngeometry: %s, %zu inliers, RMSE %.3f px", toString(result.geometry),
              result.inliers, result.rmse);
  if (std::isfinite(view.parallax)) std::printf(", parallax %.2f degrees", view.parallax);
  std::printf("\nlog10 of false alarms: homography %.1f, epipolar %.1f\n",
              view.log_false_alarms_homography, view.log_false_alarms_epipolar);
  if (two_view::hasPose(view)) {
    printPose("motion A -> B (x right, y down, z forward)", view.pose);
    if (view.pose_covariance.allFinite()) {
      const double degrees = 180.0 / CV_PI;  // over all axes
      std::printf("standard deviation: rotation %.3f degrees, direction %.3f degrees\n",
                  degrees * std::sqrt(view.pose_covariance.bottomRightCorner<3, 3>().trace()),
                  degrees * std::sqrt(view.pose_covariance.topLeftCorner<3, 3>().trace()));
    }
    if (view.other) printPose("or, as likely for this plane", view.other->pose);
  } else if (result.geometry == Geometry::epipolar) {
    std::printf("fundamental matrix (--camera fx,fy,cx,cy gives the motion)\n");
    printMatrix(view.fundamental);
  }
}

void printHomography(const Outcome& outcome, const PipelineOptions& options) {
  const MatchResult& result = outcome.result;
  printTwoView(result);
  if (result.geometry == Geometry::epipolar) return;
  if (outcome.result.status != Status::ok) {
    std::printf("\nno homography: %s\ntry: %s\n", toString(outcome.result.status),
                advice(outcome, options).c_str());
    return;
  }
  std::printf("\nhomography A -> B, %zu inliers, RMSE %.3f px, deviation from a plane %.3f px\n",
              result.inliers, result.rmse, result.answer.plane_deviation);
  printMatrix(result.answer.homography);
  if (result.alignment.status != AlignmentStatus::not_run) {
    std::printf("alignment: %s, RMSE of the aligned points %.3f px before, %.3f px after\n",
                toString(result.alignment.status), result.alignment.rmse_before,
                result.alignment.rmse_after);
  }
  const double deviation = cornerDeviation(outcome);
  std::printf("standard deviation of the least certain corner: %.3g px\n", deviation);
  if (!(deviation < kUncertainCorner)) {
    std::printf(
        "warning: uncertain where there are no inliers: they are few, blurred, or in one part "
        "of the image only\n");
  }
  if (outcome.truth) {
    std::printf("corner error against the ground truth: %.3f px\n",
                metrics::cornerError(result.answer.homography, *outcome.truth,
                                     outcome.reference.image.size()));
  }
}

void print(const Outcome& outcome, const Arguments& arguments) {
  printFrame("reference", arguments.reference, outcome.reference);
  printFrame("target", arguments.target, outcome.target);
  printStages(outcome);
  printHomography(outcome, arguments.pipeline);
}

json toJson(const metrics::ErrorSummary& summary) {
  if (summary.count == 0) return {{"mean", nullptr}, {"rms", nullptr}};
  return {{"mean", summary.mean}, {"rms", summary.rms}};
}

json toJson(const std::string& file, const Frame& frame) {
  return {{"file", file},
          {"width", frame.image.cols},
          {"height", frame.image.rows},
          {"keypoints", frame.features.size()},
          {"milliseconds", frame.extraction_milliseconds}};
}

json toJson(const StageResult& stage) {
  return {{"name", stage.name},
          {"input", stage.input},
          {"output", stage.output},
          {"milliseconds", stage.milliseconds}};
}

json toJson(const RelativePose& pose) {
  return {{"rotation", tools::toJson(pose.rotation)},
          {"translation", {pose.translation.x(), pose.translation.y(), pose.translation.z()}}};
}

json twoViewToJson(const MatchResult& result) {
  const TwoView& view = result.two_view.view;
  json out{{"log_false_alarms_homography", view.log_false_alarms_homography},
           {"log_false_alarms_epipolar", view.log_false_alarms_epipolar}};
  if (std::isfinite(view.parallax)) out["parallax"] = view.parallax;
  if (!view.fundamental.isZero(0.0)) out["fundamental"] = tools::toJson(view.fundamental);
  if (!two_view::hasPose(view)) return out;
  out["pose"] = toJson(view.pose);
  if (view.other) out["other_pose"] = toJson(view.other->pose);
  if (!view.pose_covariance.allFinite()) return out;
  out["pose_covariance"] = json::array();
  for (Eigen::Index i = 0; i < 36; ++i) {
    out["pose_covariance"].push_back(view.pose_covariance(i / 6, i % 6));
  }
  return out;
}

json toJson(const Outcome& outcome, const Arguments& arguments) {
  const MatchResult& result = outcome.result;
  json out{{"reference", toJson(arguments.reference, outcome.reference)},
           {"target", toJson(arguments.target, outcome.target)},
           {"options", tools::toJson(arguments.pipeline)},
           {"status", toString(outcome.result.status)},
           {"geometry", toString(outcome.result.geometry)},
           {"found_by", toString(outcome.result.found_by)},
           {"growth_seeds", outcome.result.growth.seeds},
           {"stages", json::array()},
           {"homography", nullptr}};
  for (std::size_t i = 0; i < outcome.distances.size(); ++i) {
    json stage = toJson(result.stages[i]);
    stage["descriptor_distance"] = toJson(outcome.distances[i]);
    if (!outcome.errors[i].empty()) {
      stage["reprojection_error"] = toJson(metrics::summarize(outcome.errors[i]));
      stage["precision_3px"] = metrics::precision(outcome.errors[i], metrics::kCorrectWithin);
    }
    out["stages"].push_back(std::move(stage));
  }
  out["refinements"] = json::array();
  for (const StageResult& s : refinementsOf(outcome)) out["refinements"].push_back(toJson(s));
  out["alignment"] = {{"status", toString(result.alignment.status)},
                      {"rmse_before", result.alignment.rmse_before},
                      {"rmse_after", result.alignment.rmse_after}};
  if (result.stage("two_view") != nullptr) out["two_view"] = twoViewToJson(result);
  if (result.geometry == Geometry::epipolar) {
    out["inliers"] = result.inliers;
    out["rmse"] = result.rmse;
  }
  if (outcome.result.status != Status::ok) return out;
  out.update(tools::toJson(result.answer));
  out["inliers"] = result.inliers;
  out["rmse"] = result.rmse;
  out["corner_deviation"] = cornerDeviation(outcome);
  if (outcome.truth) {
    out["corner_error"] = metrics::cornerError(result.answer.homography, *outcome.truth,
                                               outcome.reference.image.size());
  }
  return out;
}

/// One row per nearest neighbour; `level` is the last stage that it passed.
std::string toCsv(const Outcome& outcome) {
  const char* const levels[] = {"knn", "kt", "ktg", "ktgp"};
  const std::vector<double>& errors = outcome.errors[0];
  std::string out =
      "reference_index,target_index,reference_x,reference_y,target_x,target_y,"
      "distance,second_distance,ratio,level";
  out += outcome.truth ? ",reprojection_error\n" : "\n";
  std::size_t i = 0;
  for (const Correspondence& c : outcome.result.correspondences) {
    const auto r = static_cast<std::size_t>(c.reference_index);
    const auto t = static_cast<std::size_t>(c.target_index);
    const cv::Point2f& from = outcome.reference.features.keypoints[r].pt;
    const cv::Point2f& to = outcome.target.features.keypoints[t].pt;
    files::CsvRow row;
    row.add(r).add(t).add(from.x).add(from.y).add(to.x).add(to.y);
    row.add(c.distance).add(c.second_distance).add(c.ratio());
    row.add(levels[static_cast<std::size_t>(c.level)]);
    if (outcome.truth) row.add(errors[i++], 6);
    out += row.line();
  }
  return out;
}

void writeFiles(const Arguments& arguments, const Outcome& outcome) {
  if (!arguments.json.empty()) {
    files::writeText(arguments.json, textOf(toJson(outcome, arguments), 2), arguments.force);
  }
  if (!arguments.csv.empty()) files::writeText(arguments.csv, toCsv(outcome), arguments.force);
  if (arguments.draw.empty() && arguments.draw_stages.empty() && arguments.draw_final.empty()) {
    return;
  }
  const cv::Mat reference_image = files::readForView(arguments.reference);
  const cv::Mat target_image = files::readForView(arguments.target);
  const FrameView reference{reference_image, outcome.reference.features};
  const FrameView target{target_image, outcome.target.features};
  cv::Mat canvas;
  if (!arguments.draw.empty()) {
    drawOverlay(reference, target, outcome.result, OverlayStyle::side_by_side, canvas);
    files::writeImage(arguments.draw, canvas, arguments.force);
  }
  if (!arguments.draw_stages.empty()) {
    drawStages(reference, target, outcome.result, canvas);
    files::writeImage(arguments.draw_stages, canvas, arguments.force);
  }
  if (!arguments.draw_final.empty()) {
    drawLevel(reference, target, outcome.result, Level::ktgp, canvas);
    files::writeImage(arguments.draw_final, canvas, arguments.force);
  }
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
  app.add_option("--camera", arguments.camera,
                 "K of both images without distortion, px: with --geometry auto or epipolar, or "
                 "--preset slam, for the camera's motion")
      ->delimiter(',')
      ->expected(4)
      ->type_name("fx,fy,cx,cy");
  addCommonOptions(app, arguments.force);
  addPipelineOptions(app, arguments.pipeline, "photo");
}

int matchTwoImages(int argc, char** argv) {
  Arguments arguments;
  CLI::App app(kDescription);
  app.footer(kExamples);
  addArguments(app, arguments);
  if (const auto code = parse(app, argc, argv)) return *code;
  const bool photo = app.count("--preset") == 0 || app["--preset"]->as<std::string>() == "photo";
  arguments.features_by_area = photo && app.count("--params") + app.count("--features") == 0;

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
  if (!to_output) print(outcome, arguments);
  writeFiles(arguments, outcome);
  return outcome.result.found() == Status::ok ? kExitDone : kExitUnusedData;
}

}  // namespace
}  // namespace ktgp_orb::tools

int main(int argc, char** argv) {
  return ktgp_orb::tools::runProgram("ktgp_match",
                                     [&] { return ktgp_orb::tools::matchTwoImages(argc, argv); });
}
