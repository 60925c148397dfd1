#include "ktgp_orb/two_view.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "estimation/false_alarms.h"
#include "estimation/prosac.h"
#include "homography/smooth_field.h"
#include "homography/transform.h"
#include "homography/verdict.h"
#include "two_view/cameras.h"
#include "two_view/epipolar.h"
#include "two_view/motions.h"
#include "two_view/support.h"
#include "util/constants.h"
#include "util/names.h"
#include "util/options_check.h"
#include "util/reset_keeping.h"

namespace ktgp_orb {
namespace {

using two_view::Epipolar;
using two_view::EpipolarProblem;
using two_view::kSampsonShare;
using util::kPi;
using util::requireInRange;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

}  // namespace

const char* toString(Geometry geometry) {
  return util::nameOf<Geometry::epipolar>(geometry, {"none", "plane", "rotation", "epipolar"});
}

const char* toString(Doubt doubt) {
  return util::nameOf<Doubt::undetermined>(
      doubt, {"none", "two_motions_of_a_plane", "few_points_off_the_plane", "small_parallax",
              "repetitive", "moving_region", "mirrored", "other_motion", "undetermined"});
}

struct TwoViewEstimator::Impl {
  explicit Impl(const TwoViewOptions& given)
      : options(given),
        prosac({given.max_error, std::min(given.max_iterations, kPlaneSamples), given.confidence,
                given.seed}) {}

  static constexpr int kPlaneSamples = 250;  // a plane with less support is not what is published

  void estimate(const PointPairs& pairs, const TwoViewInput& input, TwoView& result);
  bool findEpipolar(const TwoViewInput& input, TwoView& result);
  bool startElsewhere();
  void judgeHomography(const PointPairs& pairs);
  void judgeEpipolar(const PointPairs& pairs, const TwoViewInput& input);
  void setPlane(const PointPairs& pairs, TwoView& result);
  void setRotation(const PointPairs& pairs, TwoView& result);
  bool setEpipolar(const PointPairs& pairs, const TwoViewInput& input, TwoView& result);

  TwoViewOptions options;
  ProsacHomography prosac;
  ProsacResult plane;
  bool has_plane = false;
  double log_plane = 0.0;     // of the homography
  double log_rotation = 0.0;  // of the rotation
  double log_epipolar = 0.0;
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Eigen::Matrix3d rotation_covariance = Eigen::Matrix3d::Zero();
  std::optional<two_view::Cameras> cameras;
  estimation::QualityOrder order;
  two_view::EpipolarPairs normalised;
  EpipolarProblem problem;
  estimation::ProsacSearch<EpipolarProblem> search;
  EpipolarProblem fit;  // of the answer; startElsewhere() leaves it as it is
  Epipolar epipolar;
  two_view::Support support;
  std::vector<double> chance;  // of each pair; more than 1: it does not agree
  std::vector<two_view::Displacement> displaced;
  std::vector<double> angles;
  double target_area = 0.0;
};

void TwoViewEstimator::Impl::estimate(const PointPairs& pairs, const TwoViewInput& input,
                                      TwoView& result) {
  constexpr double kMostFalseAlarms = -6.0;  // log10
  homography::requireFinite(pairs);
  cameras = two_view::camerasOf(input);
  util::resetKeeping(&TwoView::mask, result);
  result.mask.assign(pairs.size(), 0);
  result.pose_covariance.setConstant(kNaN);
  result.parallax = kNaN;
  if (pairs.size() < 4) {
    result.status = Status::too_few_matches;
    return;
  }
  plane.status = Status::no_model;
  if (options.homography) {
    prosac.estimate(pairs, input.reference_size, input.homography, plane);
  }
  target_area = estimation::coveredArea(pairs.target);
  support.load(pairs, options.max_error);
  judgeHomography(pairs);
  log_epipolar = 0.0;
  if (pairs.size() > (cameras ? 5U : 7U)) {
    order.sort(pairs.quality);
    normalised.load(pairs, order, kSampsonShare * options.max_error, cameras);
    if (findEpipolar(input, result)) judgeEpipolar(pairs, input);
  }
  const double log_homography = std::min(log_plane, log_rotation);
  result.log_false_alarms_homography = log_homography;
  result.log_false_alarms_epipolar = log_epipolar;
  if (has_plane) result.homography = plane.answer.homography;
  if (log_epipolar < std::min(log_homography, kMostFalseAlarms)) {
    if (setEpipolar(pairs, input, result)) {
      result.probability = 1.0;
      return;
    }
    result.status = Status::model_rejected;
    result.doubt = Doubt::undetermined;
  }
  if (!has_plane) return;
  result.probability = 1.0;
  if (log_rotation <= log_plane) {
    setRotation(pairs, result);
  } else {
    setPlane(pairs, result);
  }
  result.doubt = result.other ? Doubt::two_motions_of_a_plane : Doubt::none;
}

bool TwoViewEstimator::Impl::findEpipolar(const TwoViewInput& input, TwoView& result) {
  estimation::ProsacRules rules{options.max_iterations, options.confidence};
  // A strip of the limit on both sides of a line, in a square of the covered area.
  const double width = 2.0 * std::sqrt(2.0) * kSampsonShare * options.max_error;
  rules.chance_inlier = std::clamp(width / std::sqrt(std::max(target_area, 1.0)), 0.2, 0.5);
  // With little parallax, wrong motions agree with most pairs, and so with all of the best ones.
  rules.min_iterations = 40;
  rules.seed = options.seed;
  std::optional<Epipolar> initial;
  if (cameras && input.prediction && input.prediction->translation.norm() > 0.5) {
    initial = normalised.fromMotion(*input.prediction);
  }
  problem.setPairs(normalised);
  const bool found = search.run(rules, initial, problem);
  result.iterations = search.iterations();
  if (!found) return false;
  epipolar = search.best();
  fit.setPairs(normalised);
  if (!fit.minimise(epipolar)) return false;
  return !cameras || !startElsewhere() || fit.minimise(epipolar);
}

/// With little parallax, a wrong direction of the translation agrees with most pairs once the turn
/// makes up for it. Sampling stops there, and the fit does not leave it. So the fit starts again
/// from other directions, with the turn that explains the pairs without a translation.
bool TwoViewEstimator::Impl::startElsewhere() {
  constexpr int kSteps = 2;
  static const Eigen::Vector3d kDirections[] = {{0, 0, 1},  {1, 0, 0}, {0, 1, 0}, {1, 0, 1},
                                                {-1, 0, 1}, {0, 1, 1}, {0, -1, 1}};
  const Eigen::Matrix3d turn = two_view::turnOf(normalised);
  float least = problem.cost(epipolar, std::numeric_limits<float>::infinity());
  bool is_better = false;
  for (const Eigen::Vector3d& direction : kDirections) {
    RelativePose motion{turn, direction.normalized()};
    if (!two_view::isForward(normalised, motion)) motion.translation *= -1.0;
    Epipolar start = normalised.fromMotion(motion);
    for (int step = 0; step < kSteps && problem.refine(1.0, start); ++step) {
    }
    const float cost = problem.cost(start, least);
    if (!(cost < least)) continue;
    least = cost;
    epipolar = start;
    is_better = true;
  }
  return is_better;
}

/// Fills log_plane, and log_rotation where the cameras are known and only turned.
void TwoViewEstimator::Impl::judgeHomography(const PointPairs& pairs) {
  has_plane = options.homography && plane.status == Status::ok;
  log_plane = 0.0;
  log_rotation = std::numeric_limits<double>::infinity();  // there is none
  if (!has_plane) return;
  const auto judge = [&](const Eigen::Matrix3d& h, std::size_t sample) {
    chance.assign(pairs.size(), 2.0);
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      const double error = homography::errorOf(h, pairs.reference[i], pairs.target[i]);
      if (!(error < options.max_error)) continue;
      chance[i] = kPi * std::max(error * error, 1.0 / kPi) / target_area;
    }
    return support.logFalseAlarms(chance, sample, 1.0);
  };
  log_plane = judge(plane.answer.homography, 4);
  if (cameras && two_view::fitRotation(pairs, *cameras, plane.answer.homography, plane.inliers,
                                       options.max_error, rotation, rotation_covariance)) {
    log_rotation = judge(cameras->homographyOf(rotation), 2);
  }
}

/// Fills log_epipolar.
void TwoViewEstimator::Impl::judgeEpipolar(const PointPairs& pairs, const TwoViewInput& input) {
  constexpr double kLeastDistance = 0.5;  // px: with exact points everything would be significant
  constexpr double kLeastParallax = 0.2;  // px: lenses and shutters bend images by as much
  const Eigen::Matrix3d f = normalised.inPixels(epipolar);
  const double limit = kSampsonShare * options.max_error;
  const double diagonal = input.target_size.empty()
                              ? std::sqrt(2.0 * target_area)
                              : std::hypot(input.target_size.width, input.target_size.height);
  const std::size_t sample = cameras ? 5 : 7;
  const double models = cameras ? 10.0 : 3.0;
  chance.assign(pairs.size(), 2.0);
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (!(two_view::sampson(f, pairs.reference[i], pairs.target[i]) < limit)) continue;
    if (cameras && !cameras->seeInFront(epipolar.motion, pairs.reference[i], pairs.target[i],
                                        options.max_error)) {
      continue;
    }
    const double distance = two_view::distanceToLine(f, pairs.reference[i], pairs.target[i]);
    chance[i] = 2.0 * std::max(distance, kLeastDistance) * diagonal / target_area;
  }
  log_epipolar = support.logFalseAlarms(chance, sample, models);
  if (!has_plane) return;
  // Parallax: of errors from the homography in random directions, how many would be as near to the
  // epipolar line? The homography is given, so that two pairs determine the rest, the epipole.
  const bool turned = log_rotation <= log_plane;
  const Eigen::Matrix3d h = turned ? cameras->homographyOf(rotation) : plane.answer.homography;
  // On a near plane many pairs have a little parallax. Wrong pairs are farther away.
  constexpr double kNear = 2.0;  // times the limit
  displaced.assign(pairs.size(), {});
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const double error = homography::errorOf(h, pairs.reference[i], pairs.target[i]);
    const bool is_near = error < kNear * options.max_error;
    if (!is_near && chance[i] > 1.0) continue;
    const double across = two_view::distanceToLine(f, pairs.reference[i], pairs.target[i]);
    if (is_near) {
      const double least = std::max(across, kLeastDistance);
      displaced[i] = {error * error, least * least};
    }
    if (chance[i] > 1.0) continue;
    const double distance = std::max(across, kLeastParallax);
    chance[i] = distance < error ? 2.0 / kPi * std::asin(distance / error) : 1.0;
  }
  const double parallax =
      std::min(support.logFalseAlarms(chance, 2, 1.0), support.logParallax(displaced));
  log_epipolar = std::min(log_epipolar, std::min(log_plane, log_rotation) + parallax);
}

void TwoViewEstimator::Impl::setRotation(const PointPairs& pairs, TwoView& result) {
  result.status = Status::ok;
  result.geometry = Geometry::rotation;
  result.homography = cameras->homographyOf(rotation);
  homography::scaleLastToOne(result.homography);
  two_view::label(pairs, cameras, options.max_error, result);
  result.pose.rotation = rotation;
  result.pose_covariance.setZero();
  result.pose_covariance.bottomRightCorner<3, 3>() = rotation_covariance;
  result.parallax = 0.0;
}

void TwoViewEstimator::Impl::setPlane(const PointPairs& pairs, TwoView& result) {
  result.status = Status::ok;
  result.geometry = Geometry::plane;
  result.homography = plane.answer.homography;
  two_view::label(pairs, cameras, options.max_error, result);
  if (!cameras) return;
  two_view::setPlaneMotion(pairs, *cameras, plane.answer.covariance, options.max_error, result);
  if (!result.fundamental.isZero(0.0)) {
    result.parallax = two_view::parallaxOf(pairs, *cameras, result, angles);
  }
}

/// False where the inliers do not determine the geometry.
bool TwoViewEstimator::Impl::setEpipolar(const PointPairs& pairs, const TwoViewInput& input,
                                         TwoView& result) {
  constexpr double kMostTurn = 0.1;    // rad, standard deviation
  constexpr double kMostAcross = 0.7;  // rad, of the direction of the translation
  const auto corners = homography::imageCorners(input.reference_size, pairs.reference);
  const double cell =
      (corners[2] - corners[0]).norm() * normalised.scale() / homography::kCellsAlongDiagonal;
  const auto covariance = fit.covariance(epipolar, cell, options.shared_error * normalised.scale());
  if (!covariance.allFinite()) return false;
  if (cameras) {
    if (covariance.topLeftCorner<3, 3>().trace() > kMostTurn * kMostTurn ||
        covariance.bottomRightCorner<2, 2>().trace() > kMostAcross * kMostAcross) {
      return false;
    }
    result.pose = {epipolar.motion.rotation, epipolar.motion.translation};
    result.pose_covariance = two_view::poseCovariance(covariance, epipolar.motion.translation);
  }
  result.fundamental = normalised.inPixels(epipolar);
  result.scale = fit.scale() / normalised.scale();
  result.status = Status::ok;
  result.geometry = Geometry::epipolar;
  two_view::label(pairs, cameras, options.max_error, result);
  if (cameras) result.parallax = two_view::parallaxOf(pairs, *cameras, result, angles);
  return true;
}

TwoViewOptions TwoViewOptions::realCameras() {
  TwoViewOptions options;
  options.shared_error = 0.5;
  return options;
}

TwoViewEstimator::TwoViewEstimator(const TwoViewOptions& options) {
  requireInRange("two-view max_error", options.max_error, 1e-6, 1e6);
  requireInRange("two-view max_iterations", options.max_iterations, 1, 1000000);
  requireInRange("two-view shared_error", options.shared_error, 0.0, 1e3);
  requireInRange("two-view confidence", options.confidence, 1e-6, 1.0 - 1e-9);
  impl_ = std::make_unique<Impl>(options);
}

TwoViewEstimator::~TwoViewEstimator() = default;
TwoViewEstimator::TwoViewEstimator(TwoViewEstimator&&) noexcept = default;
TwoViewEstimator& TwoViewEstimator::operator=(TwoViewEstimator&&) noexcept = default;

const TwoViewOptions& TwoViewEstimator::options() const {
  return impl_->options;
}

void TwoViewEstimator::estimate(const PointPairs& pairs, const TwoViewInput& input,
                                TwoView& result) {
  impl_->estimate(pairs, input, result);
}

TwoView estimateTwoView(const std::vector<Eigen::Vector2d>& reference,
                        const std::vector<Eigen::Vector2d>& target, const TwoViewInput& input,
                        const TwoViewOptions& options) {
  PointPairs pairs;
  pairs.reference = reference;
  pairs.target = target;
  pairs.quality.resize(reference.size());
  for (std::size_t i = 0; i < reference.size(); ++i) pairs.quality[i] = static_cast<double>(i);
  TwoView result;
  TwoViewEstimator(options).estimate(pairs, input, result);
  return result;
}

}  // namespace ktgp_orb
