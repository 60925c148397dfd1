#include "ktgp_orb/planar_pose.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

#include "estimation/robust_fit.h"
#include "estimation/sandwich.h"
#include "homography/transform.h"
#include "util/camera_check.h"
#include "util/constants.h"
#include "util/geometry.h"
#include "util/small_matrix.h"

namespace ktgp_orb {
namespace {

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Vector8 = Eigen::Matrix<double, 8, 1>;

/// Reference image, px -> target, m.
Eigen::Matrix3d targetFromReference(const cv::Size& size, double width) {
  const double metre = width / size.width;  // a pixel is a square of that side
  Eigen::Matrix3d m;
  m << metre, 0.0, -0.5 * metre * (size.width - 1), 0.0, metre, -0.5 * metre * (size.height - 1),
      0.0, 0.0, 1.0;
  return m;
}

/// In front of the camera, with its face towards it.
bool isSeen(const Eigen::Isometry3d& pose) {
  return pose.translation().z() > 0.0 && pose.linear().col(2).dot(pose.translation()) > 0.0;
}

/// Both solutions of IPPE from the corners; only those in front of the camera, with the target's
/// face towards it.
std::vector<Eigen::Isometry3d> startsOf(const Eigen::Matrix3d& homography,
                                        const Eigen::Matrix3d& camera, const cv::Size& size,
                                        const Eigen::Matrix3d& target_from_reference) {
  std::vector<cv::Point3d> on_target;
  std::vector<cv::Point2d> on_image;  // with f = 1
  const Eigen::Matrix3d to_plane = camera.inverse() * homography;
  const double sign =
      to_plane.row(2).dot(Eigen::Vector3d(0.5 * size.width, 0.5 * size.height, 1.0));
  for (const Eigen::Vector2d& corner : homography::imageCorners(size, {})) {
    const Eigen::Vector3d p = to_plane * corner.homogeneous();
    if (!(p.z() * sign > 0.0)) return {};
    const Eigen::Vector2d t = homography::project(target_from_reference, corner);
    on_target.emplace_back(t.x(), t.y(), 0.0);
    on_image.emplace_back(p.x() / p.z(), p.y() / p.z());
  }
  std::vector<cv::Mat> turns, shifts;
  std::vector<Eigen::Isometry3d> starts;
  try {
    cv::solvePnPGeneric(on_target, on_image, cv::Matx33d::eye(), cv::noArray(), turns, shifts,
                        false, cv::SOLVEPNP_IPPE);
  } catch (const cv::Exception&) {
    return {};  // the corners are on a line
  }
  for (std::size_t i = 0; i < turns.size(); ++i) {
    cv::Matx33d turn;
    cv::Rodrigues(turns[i], turn);
    Eigen::Isometry3d pose = Eigen::Isometry3d::Identity();
    pose.linear() = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(turn.val);
    pose.translation() = Eigen::Map<const Eigen::Vector3d>(shifts[i].ptr<double>());
    if (pose.matrix().allFinite() && isSeen(pose)) starts.push_back(pose);
  }
  return starts;
}

/// The problem of estimation::RobustFit: the pose whose homography, reference -> image, is nearest
/// to a given one in units of its deviation.
struct PoseProblem {
  using State = Eigen::Isometry3d;

  Vector8 wanted;  // entries of the homography
  util::SmallMatrix whitening;
  Eigen::Matrix3d camera, target_from_reference;

  /// Moves by x, y, z in units of the distance, and rotates about the camera's axes, in place.
  static Eigen::Isometry3d moved(const Eigen::Isometry3d& pose, const estimation::Step& step) {
    Eigen::Isometry3d out = pose;
    out.linear() = util::rotationAbout(step.tail<3>()) * pose.linear();
    out.translation() += pose.translation().z() * step.head<3>();
    return out;
  }

  Vector8 entriesOf(const Eigen::Isometry3d& pose) const {
    Eigen::Matrix3d plane;
    plane << pose.linear().col(0), pose.linear().col(1), pose.translation();
    return util::entriesOf(camera * plane * target_from_reference);
  }

  void linearise(const Eigen::Isometry3d& pose, estimation::RobustWeights& /*all 1*/,
                 estimation::NormalEquations& sums) const {
    constexpr double kStep = 1e-6;  // relative: the differences are exact to 1e-10
    Eigen::Matrix<double, 8, 6> slope;
    for (int i = 0; i < 6; ++i) {
      const Vector6 step = kStep * Vector6::Unit(i);
      slope.col(i) = (entriesOf(moved(pose, step)) - entriesOf(moved(pose, -step))) / (2.0 * kStep);
    }
    const Vector8 rest = entriesOf(pose) - wanted;
    estimation::setLeastSquares(util::times(whitening, rest), util::times(whitening, slope), sums);
  }
};

/// The pose that the fit finds from a start; empty if it does not converge in front of the camera.
std::optional<PlanarPose> fitFrom(Eigen::Isometry3d pose, const PoseProblem& problem) {
  estimation::FitRules rules;
  rules.most_steps = 100;
  rules.converged = 1e-9;  // rad, and share of the distance
  rules.first_damping = 1e-3;
  estimation::RobustFit<const PoseProblem> fit;
  if (fit.minimise(problem, rules, pose) != estimation::FitEnd::converged || !isSeen(pose))
    return std::nullopt;
  Vector6 units = Vector6::Ones();
  units.head<3>().setConstant(pose.translation().z());
  PlanarPose found;
  found.target_to_camera = pose;
  found.covariance =
      units.asDiagonal() * estimation::inverseOf(fit.sums().squares) * units.asDiagonal();
  found.squared_error = fit.sums().cost;
  if (!found.covariance.allFinite()) return std::nullopt;
  return found;
}

/// W with W covariance W' = I. Entries of H differ in size by five orders of magnitude, so each is
/// taken in units of its own deviation.
std::optional<util::SmallMatrix> whiteningOf(const Covariance8& covariance) {
  const Vector8 deviation = covariance.diagonal().cwiseSqrt();
  if (!deviation.allFinite() || !(deviation.minCoeff() > 0.0)) return std::nullopt;
  const Covariance8 correlation =
      deviation.cwiseInverse().asDiagonal() * covariance * deviation.cwiseInverse().asDiagonal();
  const auto whitening = util::whiteningOf(correlation);
  if (!whitening) return std::nullopt;
  return util::SmallMatrix(*whitening * deviation.cwiseInverse().asDiagonal());
}

/// Adds a pose, unless it is one that is there already. The likeliest comes first, and one that is
/// much less likely is left out.
void add(const PlanarPose& pose, std::vector<PlanarPose>& poses) {
  constexpr double kSame = 1e-4;         // rad
  constexpr double kLeastShare = 0.001;  // share of the likelihood
  constexpr double kFreedom = 2.0;       // entries of H beyond a pose's six
  constexpr double kMostMisfit = 9.21;   // chi-square of two degrees of freedom, 99 %
  if (poses.empty()) {
    poses.push_back(pose);
    return;
  }
  const Eigen::AngleAxisd between(Eigen::Matrix3d(
      poses.front().target_to_camera.linear().transpose() * pose.target_to_camera.linear()));
  if (std::abs(between.angle()) < kSame) return;
  poses.push_back(pose);
  if (poses[1].squared_error < poses[0].squared_error) std::swap(poses[0], poses[1]);
  // Where the likeliest pose fits worse than the covariance allows, the errors are larger than it
  // says, and tell the two poses apart by less.
  const double misfit = poses[0].squared_error;
  const double scale = misfit > kMostMisfit ? misfit / kFreedom : 1.0;
  const double worse = poses[1].squared_error - poses[0].squared_error;
  poses[0].share = 1.0 / (1.0 + std::exp(-0.5 * worse / scale));
  poses[1].share = 1.0 - poses[0].share;
  if (poses[1].share >= kLeastShare) return;
  poses[0].share = 1.0;
  poses.pop_back();
}

// Points all over a reference image. A rolling shutter bends the picture, and a homography is
// nearest to all of it, not to its corners.
constexpr int kGridColumns = 4, kGridRows = 3, kGridPoints = kGridColumns * kGridRows;
using GridPoints = std::array<Eigen::Vector2d, kGridPoints>;

GridPoints gridOf(const cv::Size& size) {
  GridPoints points;
  for (int row = 0; row < kGridRows; ++row) {
    for (int column = 0; column < kGridColumns; ++column) {
      points.at(row * kGridColumns + column) << (column + 0.5) * size.width / kGridColumns,
          (row + 0.5) * size.height / kGridRows;
    }
  }
  return points;
}

/// Derivative of the mapped points by the homography's entries.
util::SmallMatrix jacobianAt(const GridPoints& points, const Eigen::Matrix3d& homography) {
  util::SmallMatrix jacobian(2 * kGridPoints, 8);
  for (int i = 0; i < kGridPoints; ++i) {
    jacobian.middleRows<2>(2 * i) = homography::jacobianByEntries(homography, points.at(i));
  }
  return jacobian;
}

/// Gauss-Newton from `homography`, which is near, to the one that maps the points as near as
/// possible to where they are wanted. Returns its Jacobian.
util::SmallMatrix approach(const GridPoints& points, const GridPoints& wanted,
                           Eigen::Matrix3d& homography) {
  constexpr int kSteps = 3;
  util::SmallMatrix jacobian = jacobianAt(points, homography);
  for (int step = 0; step < kSteps; ++step) {
    util::SmallMatrix rest(2 * kGridPoints, 1);
    for (int i = 0; i < kGridPoints; ++i) {
      rest.middleRows<2>(2 * i) = wanted.at(i) - homography::project(homography, points.at(i));
    }
    const util::SmallMatrix change = util::leastSquares(jacobian, rest).solution;
    for (int i = 0; i < 8; ++i) homography(i / 3, i % 3) += change(i);
    jacobian = jacobianAt(points, homography);
  }
  return jacobian;
}

/// `now`, less certain by what the usual deviation of a readout time would change. It is the same
/// error as long as the motion is the same.
UncertainHomography withUnknownShutter(const UncertainHomography& now,
                                       const UncertainHomography& before, double seconds,
                                       const cv::Size& reference_size, int rows) {
  // An image has been read when the next one begins.
  const double deviation = std::min(util::kUnknownReadout, seconds);
  const Vector8 change =
      util::entriesOf(
          withoutShutter(now, before, seconds, deviation, reference_size, rows).homography) -
      util::entriesOf(now.homography);
  UncertainHomography answer = now;
  answer.covariance += change * change.transpose();
  answer.shared_covariance += change * change.transpose();
  return answer;
}

void requireTimes(double seconds, double readout_time, const cv::Size& reference_size, int rows) {
  if (reference_size.empty()) throw std::invalid_argument("the reference image is empty");
  if (rows > 0 && seconds > 0.0 && !std::isnan(readout_time)) return;
  throw std::invalid_argument("rows are " + std::to_string(rows) +
                              ", the time between the images " + std::to_string(seconds) +
                              " s, the readout time " + std::to_string(readout_time) +
                              " s; expected at least one row, more than 0 s, and a number");
}

}  // namespace

PlanarPoses planarPoses(const Eigen::Matrix3d& homography, const Covariance8& covariance,
                        const Eigen::Matrix3d& camera, const cv::Size& reference_size,
                        double target_width) {
  if (reference_size.empty()) throw std::invalid_argument("the reference image is empty");
  if (!(target_width > 0.0)) {
    throw std::invalid_argument("target width is " + std::to_string(target_width) +
                                "; expected more than 0 m");
  }
  util::requireK("the camera matrix", camera, {});
  const Eigen::Matrix3d scale = targetFromReference(reference_size, target_width);
  PlanarPoses result;
  const auto starts = startsOf(homography, camera, reference_size, scale);
  if (starts.empty()) {
    result.problem = "the homography is not the view of a target in front of the camera";
    return result;
  }
  const auto whitening = whiteningOf(covariance);
  if (!whitening) {
    result.problem = "the homography has no covariance, or one that is not positive definite";
    return result;
  }
  const PoseProblem problem{util::entriesOf(homography), *whitening, camera, scale};
  for (const Eigen::Isometry3d& start : starts) {
    if (const auto pose = fitFrom(start, problem)) add(*pose, result.poses);
  }
  if (result.poses.empty()) {
    result.problem =
        "no pose near those of its corners has this homography: the search for it "
        "does not converge";
  }
  return result;
}

UncertainHomography withoutShutter(const UncertainHomography& now,
                                   const UncertainHomography& before, double seconds,
                                   double readout_time, const cv::Size& reference_size, int rows) {
  requireTimes(seconds, readout_time, reference_size, rows);
  if (readout_time == -1.0) return withUnknownShutter(now, before, seconds, reference_size, rows);
  const auto corners = homography::imageCorners(reference_size, {});
  if (!homography::keepsPlaneInView(now.homography, corners) ||
      !homography::keepsPlaneInView(before.homography, corners)) {
    return now;
  }
  const GridPoints points = gridOf(reference_size);
  GridPoints moved;
  util::SmallMatrix by_now = jacobianAt(points, now.homography);
  util::SmallMatrix by_before = jacobianAt(points, before.homography);
  for (int i = 0; i < kGridPoints; ++i) {
    const Eigen::Vector2d here = homography::project(now.homography, points.at(i));
    const Eigen::Vector2d there = homography::project(before.homography, points.at(i));
    const double late = readout_time * (here.y() - 0.5 * (rows - 1)) / rows;
    const double passed = seconds + readout_time * (here.y() - there.y()) / rows;
    if (!(passed > std::abs(late))) return now;
    const double share = late / passed;
    moved.at(i) = here - share * (here - there);
    by_now.middleRows<2>(2 * i) *= 1.0 - share;
    by_before.middleRows<2>(2 * i) *= share;
  }
  UncertainHomography answer = now;
  const util::SmallMatrix by_answer = approach(points, moved, answer.homography);
  by_now = util::leastSquares(by_answer, by_now).solution;
  by_before = util::leastSquares(by_answer, by_before).solution;
  // The smooth errors are about the same in both, the noise is not.
  const Covariance8 noise_now = now.covariance - now.shared_covariance;
  const Covariance8 noise_before = before.covariance - before.shared_covariance;
  answer.shared_covariance = util::propagated(by_now + by_before, now.shared_covariance);
  answer.covariance = answer.shared_covariance + Covariance8(util::propagated(by_now, noise_now)) +
                      Covariance8(util::propagated(by_before, noise_before));
  return answer;
}

}  // namespace ktgp_orb
