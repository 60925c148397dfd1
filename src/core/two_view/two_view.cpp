#include "ktgp_orb/two_view.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <stdexcept>
#include <string>
#include <utility>

#include "core/homography/transform.h"
#include "core/homography/verdict.h"
#include "core/prosac/prosac.h"
#include "core/two_view/epipolar.h"
#include "core/two_view/support.h"
#include "core/util/constants.h"
#include "core/util/options_check.h"

namespace ktgp_orb {
namespace {

using two_view::Cameras;
using two_view::Epipolar;
using two_view::Motion;
using util::kPi;
using util::requireInRange;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kSampsonShare = 0.5;  // of the limit of reprojection errors

void requireCamera(const Eigen::Matrix3d& k, const cv::Size& size, const std::string& name) {
  const auto refuse = [&](const std::string& what) {
    throw std::invalid_argument("the K of the " + name + " camera " + what);
  };
  if (!k.allFinite()) refuse("has an entry that is not finite; expected nine finite entries");
  if (!(k(0, 0) > 0.0 && k(1, 1) > 0.0)) {
    refuse("has focal lengths " + std::to_string(k(0, 0)) + ", " + std::to_string(k(1, 1)) +
           "; expected more than 0 px");
  }
  if (k(1, 0) != 0.0 || k(2, 0) != 0.0 || k(2, 1) != 0.0 || k(2, 2) != 1.0) {
    refuse("is not upper triangular with 1 as its last entry");
  }
  if (size.empty()) return;
  if (!(k(0, 2) >= 0.0 && k(0, 2) < size.width && k(1, 2) >= 0.0 && k(1, 2) < size.height)) {
    refuse("has its principal point at " + std::to_string(k(0, 2)) + ", " +
           std::to_string(k(1, 2)) + ", outside the image of " + std::to_string(size.width) + "x" +
           std::to_string(size.height) + " px; does it belong to another image size?");
  }
}

std::optional<Cameras> camerasOf(const TwoViewInput& input) {
  if (!input.reference_camera) {
    if (!input.target_camera) return std::nullopt;
    throw std::invalid_argument(
        "there is a K of the target camera and none of the reference camera; expected both or "
        "neither");
  }
  const Cameras cameras{*input.reference_camera,
                        input.target_camera.value_or(*input.reference_camera)};
  requireCamera(cameras.reference, input.reference_size, "reference");
  requireCamera(cameras.target, input.target_size, "target");
  return cameras;
}

void requireValid(const PointPairs& pairs) {
  const std::size_t n = pairs.size();
  if (pairs.target.size() != n || pairs.quality.size() != n) {
    throw std::invalid_argument("point pairs have " + std::to_string(n) + " reference points, " +
                                std::to_string(pairs.target.size()) + " target points and " +
                                std::to_string(pairs.quality.size()) +
                                " qualities; expected three equal numbers");
  }
  for (std::size_t i = 0; i < n; ++i) {
    if (pairs.reference[i].allFinite() && pairs.target[i].allFinite() &&
        std::isfinite(pairs.quality[i])) {
      continue;
    }
    throw std::invalid_argument("point pair " + std::to_string(i) +
                                " is not finite; expected finite coordinates and quality");
  }
}

void reset(std::size_t pairs, TwoView& result) {
  std::vector<std::uint8_t> mask = std::move(result.mask);  // keep the buffer
  mask.assign(pairs, 0);
  result = {};
  result.mask = std::move(mask);
  result.pose_covariance.setConstant(kNaN);
  result.parallax = kNaN;
}

Eigen::Vector3d rayOf(const Eigen::Matrix3d& inverse_k, const Eigen::Vector2d& point) {
  return inverse_k * point.homogeneous();
}

double distanceToLine(const Eigen::Matrix3d& f, const Eigen::Vector2d& x,
                      const Eigen::Vector2d& u) {
  const Eigen::Vector3d line = f * x.homogeneous();
  return std::abs(line.dot(u.homogeneous())) / std::max(line.head<2>().norm(), 1e-30);
}

double sampson(const Eigen::Matrix3d& f, const Eigen::Vector2d& x, const Eigen::Vector2d& u) {
  const Eigen::Vector3d line = f * x.homogeneous();
  const Eigen::Vector3d back = f.transpose() * u.homogeneous();
  const double length2 = line.head<2>().squaredNorm() + back.head<2>().squaredNorm();
  return std::abs(line.dot(u.homogeneous())) / std::sqrt(std::max(length2, 1e-60));
}

/// Covariance6 from that of small rotations and of two directions across the translation.
Covariance6 poseCovariance(const Eigen::Matrix<double, 5, 5>& of_step, const Eigen::Vector3d& t) {
  Eigen::Matrix<double, 6, 5> spread = Eigen::Matrix<double, 6, 5>::Zero();
  spread.topRightCorner<3, 2>() = two_view::across(t);
  spread.bottomLeftCorner<3, 3>().setIdentity();
  return spread * of_step * spread.transpose();
}

/// The homography K' R K^-1.
Eigen::Matrix3d homographyOf(const Cameras& cameras, const Eigen::Matrix3d& rotation) {
  return cameras.target * rotation * cameras.reference.inverse();
}

Eigen::Matrix3d nearestRotation(const Eigen::Matrix3d& m) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(m, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d r = svd.matrixU() * svd.matrixV().transpose();
  if (r.determinant() < 0.0) r = -r;
  return r;
}

/// A motion over a plane: K'^-1 H K = R + t n^T.
struct PlanarMotion {
  Eigen::Matrix3d rotation;
  Eigen::Vector3d translation;  // over the distance of the plane
  Eigen::Vector3d normal;
};

}  // namespace

const char* toString(Geometry geometry) {
  switch (geometry) {
    case Geometry::none:
      return "none";
    case Geometry::plane:
      return "plane";
    case Geometry::rotation:
      return "rotation";
    case Geometry::epipolar:
      return "epipolar";
  }
  return "unknown";
}

struct TwoViewEstimator::Impl {
  explicit Impl(const TwoViewOptions& given)
      : options(given),
        prosac({given.max_error, std::min(given.max_iterations, kPlaneSamples), given.confidence,
                given.seed}) {}

  void estimate(const PointPairs& pairs, const TwoViewInput& input, TwoView& result);

 private:
  static constexpr int kPlaneSamples = 250;  // a plane with less support is not what is published

  bool findEpipolar(const TwoViewInput& input, TwoView& result);
  template <std::size_t Sample>
  bool search(two_view::EpipolarProblem<Sample>& problem,
              prosac::ProsacSearch<two_view::EpipolarProblem<Sample>>& prosac_search,
              const Epipolar* initial, TwoView& result);
  void judgeHomography(const PointPairs& pairs);
  void judgeEpipolar(const PointPairs& pairs, const TwoViewInput& input);
  bool fitRotation(const PointPairs& pairs);
  void setHomography(const PointPairs& pairs, const Eigen::Matrix3d& h, TwoView& result) const;
  void setPlane(const PointPairs& pairs, TwoView& result);
  void setRotation(const PointPairs& pairs, TwoView& result) const;
  bool setEpipolar(const PointPairs& pairs, const TwoViewInput& input, TwoView& result);
  bool seenFromFront(const Motion& motion, const Eigen::Vector2d& reference,
                     const Eigen::Vector2d& target) const;
  void setParallax(const PointPairs& pairs, TwoView& result);

 public:
  TwoViewOptions options;

 private:
  ProsacHomography prosac;
  ProsacResult plane;
  bool has_plane = false;
  double log_plane = 0.0;     // of the homography
  double log_rotation = 0.0;  // of the rotation
  double log_epipolar = 0.0;
  Eigen::Matrix3d rotation;
  Eigen::Matrix3d rotation_covariance;
  std::optional<Cameras> cameras;
  Eigen::Matrix3d reference_inverse;  // of K
  Eigen::Matrix3d target_inverse;
  prosac::QualityOrder order;
  two_view::EpipolarPairs normalised;
  two_view::EpipolarProblem<5> five;
  two_view::EpipolarProblem<7> seven;
  prosac::ProsacSearch<two_view::EpipolarProblem<5>> five_search;
  prosac::ProsacSearch<two_view::EpipolarProblem<7>> seven_search;
  two_view::EpipolarFit fit;
  Epipolar epipolar;
  two_view::Support support;
  std::vector<double> chance;  // of each pair; more than 1: it does not agree
  std::vector<double> angles;
  double target_area = 0.0;
  double chance_inlier = 0.0;
};

void TwoViewEstimator::Impl::estimate(const PointPairs& pairs, const TwoViewInput& input,
                                      TwoView& result) {
  constexpr double kMostFalseAlarms = -6.0;  // log10
  requireValid(pairs);
  cameras = camerasOf(input);
  reset(pairs.size(), result);
  const std::size_t fewest = cameras ? 5 : 7;
  if (pairs.size() < 4) {
    result.status = Status::too_few_matches;
    return;
  }
  if (cameras) {
    reference_inverse = cameras->reference.inverse();
    target_inverse = cameras->target.inverse();
  }
  plane.status = Status::no_model;
  if (options.homography) {
    prosac.estimate(pairs, input.reference_size, input.homography, plane);
  }
  target_area = homography::coveredArea(pairs.target);
  support.load(pairs, options.max_error);
  judgeHomography(pairs);
  log_epipolar = 0.0;
  if (pairs.size() > fewest) {
    order.sort(pairs.quality);
    normalised.load(pairs, order, kSampsonShare * options.max_error, cameras);
    if (findEpipolar(input, result)) judgeEpipolar(pairs, input);
  }
  const double log_homography = std::min(log_plane, log_rotation);
  result.log_false_alarms_homography = log_homography;
  result.log_false_alarms_epipolar = log_epipolar;
  if (has_plane) result.homography = plane.answer.homography;
  if (log_epipolar < std::min(log_homography, kMostFalseAlarms)) {
    if (setEpipolar(pairs, input, result)) return;
    result.status = Status::model_rejected;
  }
  if (!has_plane) return;
  if (log_rotation <= log_plane && cameras) {
    setRotation(pairs, result);
  } else {
    setPlane(pairs, result);
  }
}

template <std::size_t Sample>
bool TwoViewEstimator::Impl::search(
    two_view::EpipolarProblem<Sample>& problem,
    prosac::ProsacSearch<two_view::EpipolarProblem<Sample>>& prosac_search, const Epipolar* initial,
    TwoView& result) {
  prosac::ProsacRules rules;
  rules.max_iterations = options.max_iterations;
  rules.confidence = options.confidence;
  rules.chance_inlier = chance_inlier;
  // With little parallax, wrong motions agree with most pairs, and so with all of the best ones.
  constexpr int kFewest = 40;
  rules.min_iterations = kFewest;
  rules.seed = options.seed;
  problem.setPairs(normalised);
  const prosac::ProsacRun run = prosac_search.run(rules, initial, problem);
  result.iterations = run.iterations;
  if (run.found) epipolar = prosac_search.best();
  return run.found;
}

bool TwoViewEstimator::Impl::findEpipolar(const TwoViewInput& input, TwoView& result) {
  // A strip of the limit on both sides of a line, in a square of the covered area.
  const double width = 2.0 * std::sqrt(2.0) * kSampsonShare * options.max_error;
  chance_inlier = std::clamp(width / std::sqrt(std::max(target_area, 1.0)), 0.2, 0.5);
  bool found = false;
  if (cameras) {
    std::optional<Epipolar> initial;
    if (input.prediction && input.prediction->translation.norm() > 0.5) {
      initial = normalised.fromMotion({input.prediction->rotation, input.prediction->translation});
    }
    found = search<5>(five, five_search, initial ? &*initial : nullptr, result);
  } else {
    found = search<7>(seven, seven_search, nullptr, result);
  }
  return found && fit.minimise(normalised, epipolar);
}

/// Fills log_plane, and log_rotation with cameras.
void TwoViewEstimator::Impl::judgeHomography(const PointPairs& pairs) {
  has_plane = options.homography && plane.status == Status::ok;
  log_plane = log_rotation = 0.0;
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
  if (cameras && fitRotation(pairs)) {
    log_rotation = judge(homographyOf(*cameras, rotation), 2);
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
    if (!(sampson(f, pairs.reference[i], pairs.target[i]) < limit)) continue;
    if (cameras && !seenFromFront(epipolar.motion, pairs.reference[i], pairs.target[i])) continue;
    const double distance = distanceToLine(f, pairs.reference[i], pairs.target[i]);
    chance[i] = 2.0 * std::max(distance, kLeastDistance) * diagonal / target_area;
  }
  log_epipolar = support.logFalseAlarms(chance, sample, models);
  if (!has_plane) return;
  // Parallax: of errors from the homography in random directions, how many would be as near to the
  // epipolar line? The homography is given, so that two pairs determine the rest, the epipole.
  const bool turned = cameras && log_rotation <= log_plane;
  const Eigen::Matrix3d h = turned ? homographyOf(*cameras, rotation) : plane.answer.homography;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (chance[i] > 1.0) continue;
    const double error = homography::errorOf(h, pairs.reference[i], pairs.target[i]);
    const double distance =
        std::max(distanceToLine(f, pairs.reference[i], pairs.target[i]), kLeastParallax);
    chance[i] = distance < error ? 2.0 / kPi * std::asin(distance / error) : 1.0;
  }
  const double parallax = support.logFalseAlarms(chance, 2, 1.0);
  log_epipolar = std::min(log_epipolar, std::min(log_plane, log_rotation) + parallax);
}

/// In front of both cameras, or so far away that its rays are parallel within the errors.
bool TwoViewEstimator::Impl::seenFromFront(const Motion& motion, const Eigen::Vector2d& reference,
                                           const Eigen::Vector2d& target) const {
  if (two_view::inFront(motion, rayOf(reference_inverse, reference),
                        rayOf(target_inverse, target))) {
    return true;
  }
  return homography::errorOf(homographyOf(*cameras, motion.rotation), reference, target) <
         options.max_error;
}

/// The rotation of maximum likelihood over the pairs near the homography; false where it explains
/// less than half of them.
bool TwoViewEstimator::Impl::fitRotation(const PointPairs& pairs) {
  constexpr int kSteps = 8;
  constexpr double kFreedom = 4.0;  // of Student's t
  constexpr double kEntries = 3.0;
  rotation = nearestRotation(target_inverse * plane.answer.homography * cameras->reference);
  double scale2 = options.max_error * options.max_error / 4.0;
  std::size_t near = 0;
  for (int step = 0; step < kSteps; ++step) {
    Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();
    Eigen::Matrix3d pulls = Eigen::Matrix3d::Zero();
    Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
    double weights = 0.0;
    double derivative = 0.0;
    double cost = 0.0;
    near = 0;
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      const Eigen::Vector3d p = rotation * rayOf(reference_inverse, pairs.reference[i]);
      if (!(p.z() > 1e-6)) continue;
      const Eigen::Vector2d e = (cameras->target * p).hnormalized() - pairs.target[i];
      const double e2 = e.squaredNorm();
      const double reach = 2.0 * options.max_error;
      if (!(e2 < reach * reach)) continue;
      ++near;
      Eigen::Matrix<double, 2, 3> by_point;
      by_point << cameras->target(0, 0) / p.z(), cameras->target(0, 1) / p.z(),
          -(cameras->target(0, 0) * p.x() + cameras->target(0, 1) * p.y()) / (p.z() * p.z()), 0.0,
          cameras->target(1, 1) / p.z(), -cameras->target(1, 1) * p.y() / (p.z() * p.z());
      const Eigen::Matrix<double, 2, 3> jacobian = -by_point * two_view::crossed(p);
      const double w = (kFreedom + 2.0) * scale2 / (kFreedom * scale2 + e2);
      const Eigen::Vector3d pull = w * jacobian.transpose() * e;
      squares.noalias() += w * jacobian.transpose() * jacobian;
      pulls.noalias() += pull * pull.transpose();
      gradient += pull;
      weights += w;
      derivative += w * (1.0 - e2 / (kFreedom * scale2 + e2));
      cost += w * e2;
    }
    if (near <= 4 || 2 * near < plane.inliers) return false;
    const Eigen::LDLT<Eigen::Matrix3d> ldlt(squares);
    if (ldlt.info() != Eigen::Success || !ldlt.isPositive()) return false;
    rotation = two_view::turned(-weights / derivative * ldlt.solve(gradient), rotation);
    const Eigen::Matrix3d bread =
        weights / derivative * ldlt.solve(Eigen::Matrix3d::Identity()).eval();
    const double n = 2.0 * static_cast<double>(near);
    rotation_covariance = n / (n - kEntries) * bread * pulls * bread.transpose();
    scale2 = std::max(n / (n - kEntries) * cost / (2.0 * weights), 1e-8);
  }
  rotation = nearestRotation(rotation);
  return true;
}

void TwoViewEstimator::Impl::setHomography(const PointPairs& pairs, const Eigen::Matrix3d& h,
                                           TwoView& result) const {
  result.status = Status::ok;
  result.homography = h;
  result.inliers = 0;
  double sum = 0.0;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const double error = homography::errorOf(h, pairs.reference[i], pairs.target[i]);
    result.mask[i] = error < options.max_error ? 1 : 0;
    if (result.mask[i] == 0) continue;
    ++result.inliers;
    sum += error * error;
  }
  result.rmse = std::sqrt(sum / static_cast<double>(std::max<std::size_t>(result.inliers, 1)));
}

void TwoViewEstimator::Impl::setRotation(const PointPairs& pairs, TwoView& result) const {
  Eigen::Matrix3d h = homographyOf(*cameras, rotation);
  homography::scaleLastToOne(h);
  setHomography(pairs, h, result);
  result.geometry = Geometry::rotation;
  result.pose.rotation = rotation;
  result.pose_covariance.setZero();
  result.pose_covariance.bottomRightCorner<3, 3>() = rotation_covariance;
  result.parallax = 0.0;
}

/// The poses of a plane: those of the decomposition (Malis & Vargas, 2007) that see its front. The
/// likelier one agrees better with all pairs; where both agree alike, it faces the plane more.
void TwoViewEstimator::Impl::setPlane(const PointPairs& pairs, TwoView& result) {
  setHomography(pairs, plane.answer.homography, result);
  result.geometry = Geometry::plane;
  if (!cameras) return;
  cv::Matx33d calibrated;
  const Eigen::Matrix3d g = target_inverse * plane.answer.homography * cameras->reference;
  for (int i = 0; i < 9; ++i) calibrated(i / 3, i % 3) = g(i / 3, i % 3);
  std::vector<cv::Mat> rotations;
  std::vector<cv::Mat> translations;
  std::vector<cv::Mat> normals;
  cv::decomposeHomographyMat(calibrated, cv::Matx33d::eye(), rotations, translations, normals);
  std::optional<PlanarMotion> best;
  std::optional<PlanarMotion> second;
  double best_cost = 0.0;
  double second_cost = 0.0;
  for (std::size_t k = 0; k < rotations.size(); ++k) {
    PlanarMotion motion;
    for (int i = 0; i < 9; ++i) {
      motion.rotation(i / 3, i % 3) = rotations[k].at<double>(i / 3, i % 3);
    }
    for (int i = 0; i < 3; ++i) {
      motion.translation[i] = translations[k].at<double>(i);
      motion.normal[i] = normals[k].at<double>(i);
    }
    const double length = motion.translation.norm();
    if (!(length > 1e-9) || !(motion.rotation.determinant() > 0.0)) continue;
    std::size_t front = 0;
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      front += result.mask[i] != 0 &&
               motion.normal.dot(rayOf(reference_inverse, pairs.reference[i])) > 0.0;
    }
    if (2 * front < result.inliers) continue;
    const Eigen::Matrix3d f = target_inverse.transpose() *
                              (two_view::crossed(motion.translation / length) * motion.rotation) *
                              reference_inverse;
    const double limit = kSampsonShare * options.max_error;
    double cost = 1e-3 * static_cast<double>(pairs.size()) * (1.0 - motion.normal.z());
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      const double error = sampson(f, pairs.reference[i], pairs.target[i]);
      cost += result.mask[i] != 0 ? 0.0 : std::min(error / limit, 1.0);
    }
    if (!best || cost < best_cost) {
      second = best;
      second_cost = best_cost;
      best = motion;
      best_cost = cost;
    } else if (!second || cost < second_cost) {
      second = motion;
      second_cost = cost;
    }
  }
  if (!best) return;
  const Eigen::Vector3d direction = best->translation.normalized();
  result.pose = {best->rotation, direction};
  result.fundamental = target_inverse.transpose() * two_view::crossed(direction) * best->rotation *
                       reference_inverse;
  result.fundamental /= result.fundamental.norm();
  if (second) result.other_pose = RelativePose{second->rotation, second->translation.normalized()};
  setParallax(pairs, result);

  // H's first eight entries by rotation, translation and the plane's normal.
  const double length = best->translation.norm();
  const Eigen::Matrix<double, 3, 2> around = two_view::across(direction);
  const Eigen::Matrix<double, 3, 2> tilts = two_view::across(best->normal);
  const Eigen::Matrix3d motion = best->rotation + best->translation * best->normal.transpose();
  const Eigen::Matrix3d h = cameras->target * motion * reference_inverse;
  Eigen::Matrix<double, 8, 8> by_motion;
  const auto set = [&](int column, const Eigen::Matrix3d& change) {
    const Eigen::Matrix3d d = cameras->target * change * reference_inverse;
    for (int i = 0; i < 8; ++i) {
      by_motion(i, column) = (d(i / 3, i % 3) - h(i / 3, i % 3) / h(2, 2) * d(2, 2)) / h(2, 2);
    }
  };
  for (int i = 0; i < 3; ++i) set(i, two_view::crossed(Eigen::Vector3d::Unit(i)) * best->rotation);
  for (int i = 0; i < 2; ++i) set(3 + i, length * around.col(i) * best->normal.transpose());
  set(5, best->translation * best->normal.transpose());
  for (int i = 0; i < 2; ++i) set(6 + i, best->translation * tilts.col(i).transpose());
  const Eigen::Matrix<double, 8, 8> back = by_motion.inverse();
  const Eigen::Matrix<double, 8, 8> covariance = back * plane.answer.covariance * back.transpose();
  result.pose_covariance = poseCovariance(covariance.topLeftCorner<5, 5>(), direction);
}

/// False where the inliers do not determine the geometry.
bool TwoViewEstimator::Impl::setEpipolar(const PointPairs& pairs, const TwoViewInput& input,
                                         TwoView& result) {
  constexpr double kMostTurn = 0.1;    // rad, standard deviation
  constexpr double kMostAcross = 0.7;  // rad, of the direction of the translation
  constexpr double kCells = 16.0;      // along the diagonal, as for homographies
  const auto corners = homography::imageCorners(input.reference_size, pairs.reference);
  const double cell = (corners[2] - corners[0]).norm() * normalised.scale() / kCells;
  const auto covariance =
      fit.covariance(normalised, epipolar, cell, options.shared_error * normalised.scale());
  if (!covariance.allFinite()) return false;
  if (cameras) {
    if (covariance.topLeftCorner<3, 3>().trace() > kMostTurn * kMostTurn ||
        covariance.bottomRightCorner<2, 2>().trace() > kMostAcross * kMostAcross) {
      return false;
    }
    result.pose = {epipolar.motion.rotation, epipolar.motion.translation};
    result.pose_covariance = poseCovariance(covariance, epipolar.motion.translation);
  }
  result.fundamental = normalised.inPixels(epipolar);
  result.scale = fit.scale() / normalised.scale();
  const double limit = kSampsonShare * options.max_error;
  double sum = 0.0;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const double error = sampson(result.fundamental, pairs.reference[i], pairs.target[i]);
    if (!(error < limit)) continue;
    if (cameras && !seenFromFront(epipolar.motion, pairs.reference[i], pairs.target[i])) continue;
    result.mask[i] = 1;
    ++result.inliers;
    sum += error * error;
  }
  result.rmse = std::sqrt(sum / static_cast<double>(std::max<std::size_t>(result.inliers, 1)));
  result.status = Status::ok;
  result.geometry = Geometry::epipolar;
  if (cameras) setParallax(pairs, result);
  return true;
}

void TwoViewEstimator::Impl::setParallax(const PointPairs& pairs, TwoView& result) {
  angles.clear();
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (result.mask[i] == 0) continue;
    const Eigen::Vector3d a = result.pose.rotation * rayOf(reference_inverse, pairs.reference[i]);
    const Eigen::Vector3d b = rayOf(target_inverse, pairs.target[i]);
    angles.push_back(std::atan2(a.cross(b).norm(), a.dot(b)));
  }
  if (angles.empty()) return;
  const auto middle = angles.begin() + static_cast<std::ptrdiff_t>(angles.size() / 2);
  std::nth_element(angles.begin(), middle, angles.end());
  result.parallax = *middle * 180.0 / kPi;
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

void triangulate(const PointPairs& pairs, const TwoViewInput& input, const TwoView& geometry,
                 std::vector<ScenePoint>& points) {
  constexpr double kClear = 2.0;        // scales of the errors
  constexpr double kLeastScale = 0.05;  // px
  points.clear();
  const std::optional<Cameras> cameras = camerasOf(input);
  if (!cameras || geometry.status != Status::ok || geometry.pose.translation.isZero(0.0)) return;
  if (geometry.mask.size() != pairs.size()) {
    throw std::invalid_argument("the geometry is of " + std::to_string(geometry.mask.size()) +
                                " pairs, and there are " + std::to_string(pairs.size()));
  }
  const Eigen::Matrix3d reference_inverse = cameras->reference.inverse();
  const Eigen::Matrix3d turn = geometry.pose.rotation;
  const Eigen::Vector3d t = geometry.pose.translation;
  const Eigen::Matrix3d far = homographyOf(*cameras, turn);
  const double scale = std::max(geometry.scale > 0.0 ? geometry.scale : geometry.rmse, kLeastScale);
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (geometry.mask[i] == 0) continue;
    if (homography::errorOf(far, pairs.reference[i], pairs.target[i]) < kClear * scale) continue;
    // The inverse depth z: the target point is K' (R q + z t), linear in z after multiplication.
    const Eigen::Vector3d q = rayOf(reference_inverse, pairs.reference[i]);
    const Eigen::Vector3d a = cameras->target * turn * q;
    const Eigen::Vector3d b = cameras->target * t;
    const Eigen::Vector2d u = pairs.target[i];
    const Eigen::Vector2d slope = b.head<2>() - u * b.z();
    const Eigen::Vector2d value = u * a.z() - a.head<2>();
    const double inverse_depth = slope.dot(value) / slope.squaredNorm();
    const double depth = 1.0 / inverse_depth;
    if (!(inverse_depth > 1e-9) || !((a + inverse_depth * b).z() > 0.0)) continue;
    ScenePoint point;
    point.pair = i;
    point.position = depth * q;
    // px of the target by depth, then the two directions across the ray.
    const Eigen::Vector3d seen = a + inverse_depth * b;
    const double by_inverse = slope.norm() / seen.z();
    const double depth_deviation = std::sqrt(2.0) * scale / by_inverse * depth * depth;
    const double across = scale * depth / cameras->reference(0, 0);
    point.covariance = depth_deviation * depth_deviation * q * q.transpose();
    point.covariance(0, 0) += across * across;
    point.covariance(1, 1) += across * across;
    points.push_back(point);
  }
}

}  // namespace ktgp_orb
