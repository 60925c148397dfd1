#include "tools/pair_report.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "homography/part_in_view.h"
#include "homography/transform.h"
#include "matching/standing/standing.h"
#include "tools/matcher_cli.h"
#include "two_view/cameras.h"
#include "two_view/fields.h"
#include "util/format.h"
#include "util/keypoint_position.h"

namespace ktgp_orb::tools {
namespace {

using nlohmann::json;

/// px; we warn if the standard deviation of a corner is larger. It equals metrics::kCorrectWithin,
/// the largest error of a correct match.
constexpr double kUncertainCorner = 3.0;

/// We warn of a scene with depth if its geometry has this many times the inliers of the homography.
/// The share of the matches that the homography loses and the RMSE do not tell the two apart: blur
/// raises both in a plane, too. Measured: at most 1.00 for planes (Oxford and the hard pairs), and
/// 1.10 to 1.33 for the seven scenes with depth that no other warning named.
constexpr double kMoreWithDepth = 1.05;

/// Returns the reason why a stage has no numbers; empty if the stage ran.
const char* whyNotRun(const StageResult& stage, const MatcherOptions& options) {
  if (stage.id == StageId::gms && !options.gms.enabled) return "off";
  return stage.id >= StageId::prosac && stage.milliseconds == 0.0 ? "not needed" : "";
}

/// Remark that is printed beside the numbers of a stage.
std::string noteOn(const StageResult& stage, const MatchResult& result,
                   const MatcherOptions& options) {
  switch (stage.id) {
    case StageId::tf:
      return util::format("T_w %g%s", options.ratio_threshold.value_or(0.0),
                          options.mutual ? ", both nearest to each other (mutual)" : "");
    case StageId::growth:
      return util::format("%d seeds", result.growth.seeds);
    case StageId::guided:
      return "matches added near the homography's prediction";
    case StageId::align:
      return "moved to hundredths of a pixel; the others stay inliers";
    default:
      return "";
  }
}

void printFrame(const char* role, const std::string& file, const Features& features,
                double milliseconds) {
  std::printf("%-9s  %s, %dx%d px, %zu keypoints in %.1f ms\n", role, file.c_str(),
              features.image_size.width, features.image_size.height, features.size(), milliseconds);
}

void printStage(const Outcome& outcome, std::size_t i, const MatcherOptions& options) {
  const MatchResult& result = outcome.pair.match;
  const StageResult& s = result.stages[i];
  const std::string idle = whyNotRun(s, options);
  if (!idle.empty()) {
    std::printf("%-8s %6s\n", toString(s.id), idle.c_str());
    return;
  }
  std::printf("%-8s %6zu  %6zu ", toString(s.id), s.input, s.output);
  const std::string note = noteOn(s, result, options);
  if (i >= outcome.distances.size()) {
    std::printf("%6s %8.2f  %s\n", "", s.milliseconds, note.c_str());
    return;
  }
  std::printf("%5.1f%% %8.2f  %13.3f %6.3f", 100.0 * metrics::retention(s.output, s.input),
              s.milliseconds, outcome.distances[i].mean, outcome.distances[i].rms);
  if (outcome.truth) {
    const metrics::ErrorSummary error = metrics::summarize(outcome.errors[i]);
    std::printf("  %10.1f%%  %7.2f px  %7.2f",
                100.0 * metrics::precision(outcome.errors[i], metrics::kCorrectWithin), error.mean,
                error.rms);
  }
  std::printf("%s%s\n", note.empty() ? "" : "  ", note.c_str());
}

void printStages(const Outcome& outcome, const MatcherOptions& options) {
  std::printf("\nstage     input  output   kept       ms  distance mean    rms");
  if (outcome.truth) std::printf("  within 3 px  error mean      rms");
  std::printf("\n");
  const MatchResult& result = outcome.pair.match;
  for (std::size_t i = 0; i < result.stages.size(); ++i) printStage(outcome, i, options);
  if (result.status != Status::ok) return;
  std::printf("inliers  %zu: ", result.inliers);
  if (result.guided.empty()) {
    std::printf("matches that agree with the geometry, %s\n", toString(result.geometry));
  } else {
    std::printf("%zu of the matches above, and %zu guided ones\n",
                result.inliers - result.guided.size(), result.guided.size());
  }
}

/// The corners of the part of A that is visible in B, px of A. If this part is unknown, the corners
/// of A.
std::vector<Eigen::Vector2d> commonCorners(const Outcome& outcome) {
  const Eigen::Matrix3d h = homography::facing(outcome.pair.match.answer.homography);
  const auto corners = homography::imageCorners(outcome.pair.reference.image_size, {});
  std::vector<Eigen::Vector2d> common(corners.begin(), corners.end());
  std::vector<cv::Point2f> outline;
  std::vector<cv::Point2f> target;
  std::vector<cv::Point2f> overlap;
  target.reserve(corners.size());
  for (const Eigen::Vector2d& corner :
       homography::partInView(h, corners, homography::kNearHorizon)) {
    const Eigen::Vector2d p = homography::project(h, corner);
    outline.emplace_back(static_cast<float>(p.x()), static_cast<float>(p.y()));
  }
  for (const Eigen::Vector2d& corner :
       homography::imageCorners(outcome.pair.target.image_size, {})) {
    target.emplace_back(static_cast<float>(corner.x()), static_cast<float>(corner.y()));
  }
  if (outline.size() >= 3) cv::intersectConvexConvex(outline, target, overlap);
  if (overlap.size() < 3) return common;
  common.clear();
  common.reserve(overlap.size());
  const Eigen::Matrix3d back = h.inverse();
  for (const cv::Point2f& p : overlap) common.push_back(homography::project(back, {p.x, p.y}));
  return common;
}

/// The standard deviation of `corner` after the mapping to B, px of B.
double cornerDeviation(const Outcome& outcome, const Eigen::Vector2d& corner) {
  const UncertainHomography& answer = outcome.pair.match.answer;
  return homography::cornerDeviation(answer.homography, answer.covariance,
                                     {corner, corner, corner, corner})
      .target;
}

/// The largest standard deviation of one of the `corners` after the mapping to B, px of B.
double cornerDeviation(const Outcome& outcome, const std::vector<Eigen::Vector2d>& corners) {
  double largest = 0.0;
  for (const Eigen::Vector2d& corner : corners) {
    const double deviation = cornerDeviation(outcome, corner);
    largest = std::isfinite(deviation) ? std::max(largest, deviation) : deviation;
  }
  return largest;
}

double areaOf(const std::vector<cv::Point2f>& points) {
  if (points.size() < 3) return 0.0;
  std::vector<cv::Point2f> hull;
  cv::convexHull(points, hull);
  return cv::contourArea(hull);
}

/// Explains why the homography is uncertain: few inliers, inliers in only a part of the image, a
/// scene that is not flat, or inliers with large errors.
std::string causeOf(const Outcome& outcome, const std::vector<Eigen::Vector2d>& corners) {
  constexpr std::size_t kFew = 50;
  constexpr double kPart = 0.5;
  const MatchResult& result = outcome.pair.match;
  std::vector<cv::Point2f> places;
  std::vector<cv::Point2f> common;
  places.reserve(result.inliers);
  common.reserve(corners.size());
  for (const auto* list : {&result.correspondences, &result.guided}) {
    for (const Correspondence& c : *list) {
      if (c.level < Level::ktgp) continue;
      places.push_back(util::imagePoint(outcome.pair.reference, c.reference_index));
    }
  }
  for (const Eigen::Vector2d& c : corners) {
    common.emplace_back(static_cast<float>(c.x()), static_cast<float>(c.y()));
  }
  const double share = areaOf(places) / std::max(areaOf(common), 1.0);
  std::vector<std::string> causes;
  if (result.inliers < kFew)
    causes.push_back(util::format("there are %zu inliers", result.inliers));
  if (share < kPart) {
    causes.push_back(util::format("they cover %.0f %% of what both images show", 100.0 * share));
  }
  if (result.answer.plane_deviation > 0.0) {
    causes.push_back(
        util::format("the scene is %.1f px off a plane", result.answer.plane_deviation));
  }
  if (causes.empty()) causes.push_back(util::format("the inliers scatter by %.1f px", result.rmse));
  return util::joined(causes, ", ");
}

/// Explains why nothing was found, and suggests what the user can try.
std::string advice(const Outcome& outcome, const PipelineOptions& options) {
  const MatcherOptions& matcher = options.matcher;
  if (outcome.pair.match.status == Status::too_few_features) {
    return "an image has hardly any corners: is it sharp, bright and textured? A lower "
           "--fast_threshold finds weaker ones";
  }
  const cv::Size& a = outcome.pair.reference.image_size;
  const cv::Size& b = outcome.pair.target.image_size;
  const std::string size = noteOnSize(std::max({a.width, a.height, b.width, b.height}));
  const std::string more = size.empty() ? "" : "; " + size;
  if (!matcher.growth.enabled || matcher.growth.views == 0 ||
      options.orb.descriptor != DescriptorKind::teblid) {
    const bool needs_homography = matcher.geometry == GeometryModel::homography;
    return "--preset photo" + std::string(needs_homography ? "" : " --geometry auto") +
           " finds more than these settings if the views differ strongly" + more;
  }
  if (outcome.pair.match.growth.is_repetitive) {
    return "what both images show repeats itself, and nothing tells which place is right; expected "
           "images with a larger part in common, or with details that exist only once" +
           more;
  }
  constexpr int kMost = 20000;  // largest value of the parameter `features`
  const bool has_all = outcome.pair.max_features >= kMost;
  return "no plane that both images show was recognised. If they do show one: " +
         std::string(has_all ? "" : "--features 20000 for small details, or ") +
         "cut both images to the common part" + more;
}

void printMatrix(const Eigen::Matrix3d& m) {
  for (int row = 0; row < 3; ++row) {
    std::printf("  %15.8g %15.8g %15.8g\n", m(row, 0), m(row, 1), m(row, 2));
  }
}

void printPose(const std::string& heading, const RelativePose& pose, const Covariance6& covariance,
               double probability) {
  std::printf("%s, probability %.2f: rotation | translation\n", heading.c_str(), probability);
  for (int row = 0; row < 3; ++row) {
    std::printf("  %12.8f %12.8f %12.8f | %12.8f\n", pose.rotation(row, 0), pose.rotation(row, 1),
                pose.rotation(row, 2), pose.translation[row]);
  }
  if (!covariance.allFinite()) return;
  // Factor from rad to degrees. Each trace below sums the variances of the three axes.
  const double degrees = 180.0 / CV_PI;
  std::printf("standard deviation: rotation %.3f degrees, ",
              degrees * std::sqrt(covariance.bottomRightCorner<3, 3>().trace()));
  const double translation = std::sqrt(covariance.topLeftCorner<3, 3>().trace());
  if (pose.translation.isZero()) {  // a pure rotation: how large may an unseen translation be?
    std::printf("translation %.2g of the distance of the scene\n", translation);
  } else if (degrees * translation < 90.0) {
    std::printf("direction %.3f degrees\n", degrees * translation);
  } else {
    std::printf("direction not known\n");
  }
}

void printTwoView(const MatchResult& result) {
  const TwoView& view = result.two_view.view;
  if (result.stage(StageId::two_view) == nullptr || result.geometry == Geometry::none) return;
  std::printf("\ngeometry: %s, %zu inliers, RMSE %.3f px", toString(result.geometry),
              result.inliers, result.rmse);
  if (std::isfinite(view.parallax)) std::printf(", parallax %.2f degrees", view.parallax);
  std::printf("\nlog10 of false alarms: homography %.1f, epipolar %.1f\n",
              view.log_false_alarms_homography, view.log_false_alarms_epipolar);
  if (view.doubt != Doubt::none) std::printf("doubt: %s\n", toString(view.doubt));
  if (two_view::hasPose(view)) {
    printPose("motion A -> B (x right, y down, z forward)", view.pose, view.pose_covariance,
              view.probability);
    if (view.other) {
      printPose(std::string("or (") + toString(view.other->geometry) + ")", view.other->pose,
                view.other->pose_covariance, view.other->probability);
    }
  } else if (result.geometry == Geometry::epipolar) {
    std::printf("fundamental matrix (--camera fx,fy,cx,cy gives the motion)\n");
    printMatrix(view.fundamental);
  }
}

/// The number of matches that agree with the geometry of a scene with depth; 0 if a homography
/// explains the matches as well.
std::size_t inliersWithDepth(const Outcome& outcome, MatcherOptions options) {
  options.geometry = GeometryModel::automatic;
  KtgpMatcher matcher(options);
  MatchResult result;
  matcher.match(outcome.pair.reference, outcome.pair.target, {}, result);
  return result.geometry == Geometry::epipolar ? result.inliers : 0;
}

void warnOfDepth(const Outcome& outcome, const MatcherOptions& options) {
  if (options.geometry != GeometryModel::homography) return;
  const std::size_t inliers = outcome.pair.match.inliers;
  const std::size_t with_depth = inliersWithDepth(outcome, options);
  if (static_cast<double>(with_depth) < kMoreWithDepth * static_cast<double>(inliers)) return;
  std::printf(
      "warning: the scene is no plane: %zu matches agree with a scene with depth, %zu with this "
      "homography, which holds for a part of it; --preset slam finds the geometry of the scene\n",
      with_depth, inliers);
}

void printHomography(const Outcome& outcome, const PipelineOptions& options) {
  const MatchResult& result = outcome.pair.match;
  printTwoView(result);
  if (result.geometry == Geometry::epipolar) return;
  if (result.status != Status::ok) {
    const bool any = options.matcher.geometry == GeometryModel::homography;
    std::printf("\nno %s: %s", any ? "homography" : "geometry", toString(result.status));
    const Doubt doubt = result.two_view.view.doubt;
    if (doubt != Doubt::none) std::printf(" (%s)", toString(doubt));
    std::printf("\ntry: %s\n", advice(outcome, options).c_str());
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
  const std::vector<Eigen::Vector2d> corners = commonCorners(outcome);
  const double deviation = cornerDeviation(outcome, corners);
  std::printf("standard deviation of the least certain corner of what both show: %.3g px\n",
              deviation);
  if (!(deviation < kUncertainCorner)) {
    std::printf("warning: uncertain where there are no inliers: %s\n",
                causeOf(outcome, corners).c_str());
  }
  if (result.hasStillThings()) {
    std::printf("warning: %s (%zu matches)\n", matching::kThingsStandStill, result.still);
  }
  warnOfDepth(outcome, options.matcher);
  if (outcome.truth) {
    std::printf("corner error against the ground truth: %.3f px\n",
                metrics::cornerError(result.answer.homography, *outcome.truth,
                                     outcome.pair.reference.image_size));
  }
}

json toJson(const metrics::ErrorSummary& summary) {
  if (summary.count == 0) return {{"mean", nullptr}, {"rms", nullptr}};
  return {{"mean", summary.mean}, {"rms", summary.rms}};
}

json toJson(const std::string& file, const Features& features, double milliseconds) {
  return {{"file", file},
          {"width", features.image_size.width},
          {"height", features.image_size.height},
          {"keypoints", features.size()},
          {"milliseconds", milliseconds}};
}

json toJson(const StageResult& stage) {
  return {{"name", toString(stage.id)},
          {"input", stage.input},
          {"output", stage.output},
          {"milliseconds", stage.milliseconds}};
}

json toJson(const RelativePose& pose) {
  return {{"rotation", tools::toJson(pose.rotation)},
          {"translation", {pose.translation.x(), pose.translation.y(), pose.translation.z()}}};
}

json pointsToJson(const std::vector<ScenePoint>& points) {
  json out = json::array();
  for (const ScenePoint& p : points) {
    out.push_back({p.position.x(), p.position.y(), p.position.z(), two_view::distanceDeviation(p)});
  }
  return out;
}

json twoViewToJson(const Outcome& outcome) {
  const TwoView& view = outcome.pair.match.two_view.view;
  json out{{"doubt", toString(view.doubt)}};
  two_view::visitNumbers(
      [&](const two_view::NumberField& field, double value) {
        if (std::isfinite(value)) out[field.name] = value;
      },
      view);
  if (!view.fundamental.isZero(0.0)) out["fundamental"] = tools::toJson(view.fundamental);
  if (!two_view::hasPose(view)) return out;
  out["pose"] = toJson(view.pose);
  if (view.pose_covariance.allFinite()) out["pose_covariance"] = rowsOf(view.pose_covariance);
  if (view.other) {
    out["other_pose"] = toJson(view.other->pose);
    out["other_pose"]["geometry"] = toString(view.other->geometry);
    out["other_pose"]["probability"] = view.other->probability;
    if (view.other->pose_covariance.allFinite()) {
      out["other_pose"]["covariance"] = rowsOf(view.other->pose_covariance);
    }
  }
  out["points"] = pointsToJson(pointsOf(outcome));
  return out;
}

}  // namespace

std::vector<ScenePoint> pointsOf(const Outcome& outcome) {
  std::vector<ScenePoint> points;
  const TwoViewMatches& found = outcome.pair.match.two_view;
  if (!outcome.hints.reference_camera || found.view.mask.size() != found.pairs.size()) {
    return points;
  }
  TwoViewInput input;
  input.reference_camera = outcome.hints.reference_camera;
  input.target_camera = outcome.hints.target_camera;
  triangulate(found, input, points);
  return points;
}

void print(const Outcome& outcome, const PipelineOptions& options) {
  const PairMatch& pair = outcome.pair;
  printFrame("reference", outcome.reference_file, pair.reference, pair.reference_milliseconds);
  printFrame("target", outcome.target_file, pair.target, pair.target_milliseconds);
  printStages(outcome, options.matcher);
  printHomography(outcome, options);
}

/// JSON of a stage that selects matches: the descriptor distances of the remaining matches and, if
/// the true homography is known, their errors.
json matchingStage(const Outcome& outcome, std::size_t i) {
  json stage = toJson(outcome.pair.match.stages[i]);
  stage["descriptor_distance"] = toJson(outcome.distances[i]);
  if (!outcome.errors[i].empty()) {
    stage["reprojection_error"] = toJson(metrics::summarize(outcome.errors[i]));
    stage["precision_3px"] = metrics::precision(outcome.errors[i], metrics::kCorrectWithin);
  }
  return stage;
}

json toJson(const Outcome& outcome, const PipelineOptions& options) {
  const PairMatch& pair = outcome.pair;
  const MatchResult& result = pair.match;
  json out{
      {"reference", toJson(outcome.reference_file, pair.reference, pair.reference_milliseconds)},
      {"target", toJson(outcome.target_file, pair.target, pair.target_milliseconds)},
      {"options", tools::toJson(options)},
      {"status", toString(result.status)},
      {"geometry", toString(result.geometry)},
      {"found_by", toString(result.found_by)},
      {"growth_seeds", result.growth.seeds},
      {"stages", json::array()},
      {"refinements", json::array()},
      {"homography", nullptr}};
  for (std::size_t i = 0; i < outcome.distances.size(); ++i) {
    out["stages"].push_back(matchingStage(outcome, i));
  }
  for (std::size_t i = outcome.distances.size(); i < result.stages.size(); ++i) {
    out["refinements"].push_back(toJson(result.stages[i]));
  }
  out["alignment"] = {{"status", toString(result.alignment.status)},
                      {"rmse_before", result.alignment.rmse_before},
                      {"rmse_after", result.alignment.rmse_after}};
  if (result.stage(StageId::two_view) != nullptr) out["two_view"] = twoViewToJson(outcome);
  if (result.status != Status::ok) return out;
  out["inliers"] = result.inliers;
  out["rmse"] = result.rmse;
  if (result.homographyStatus() != Status::ok) return out;
  out.update(tools::toJson(result.answer));
  const std::vector<Eigen::Vector2d> corners = commonCorners(outcome);
  out["corner_deviation"] = cornerDeviation(outcome, corners);
  for (const Eigen::Vector2d& corner : corners) {
    const Eigen::Vector2d place = homography::project(result.answer.homography, corner);
    out["corners"].push_back({{"reference", {corner.x(), corner.y()}},
                              {"target", {place.x(), place.y()}},
                              {"deviation", cornerDeviation(outcome, corner)}});
  }
  if (outcome.truth) {
    out["corner_error"] =
        metrics::cornerError(result.answer.homography, *outcome.truth, pair.reference.image_size);
  }
  return out;
}

}  // namespace ktgp_orb::tools
