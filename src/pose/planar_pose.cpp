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

/// Maps positions in the reference image, px, to positions on the target, m.
Eigen::Matrix3d targetFromReference(const cv::Size& size, double width) {
  const double metre = width / size.width;  // side of a pixel on the target, m
  Eigen::Matrix3d m;
  m << metre, 0.0, -0.5 * metre * (size.width - 1), 0.0, metre, -0.5 * metre * (size.height - 1),
      0.0, 0.0, 1.0;
  return m;
}

/// Returns true if the target is in front of the camera and its face is turned towards the camera.
bool isSeen(const Eigen::Isometry3d& pose) {
  return pose.translation().z() > 0.0 && pose.linear().col(2).dot(pose.translation()) > 0.0;
}

/// Returns the solutions of IPPE for the four corners, at most two. Solutions in which the target
/// is behind the camera or its face is turned away are left out.
std::vector<Eigen::Isometry3d> startsOf(const Eigen::Matrix3d& homography,
                                        const Eigen::Matrix3d& camera, const cv::Size& size,
                                        const Eigen::Matrix3d& target_from_reference) {
  std::vector<cv::Point3d> on_target;
  std::vector<cv::Point2d> on_image;  // corners in normalised coordinates (K = identity)
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
    return {};  // the four corners lie on a line
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

/// The problem for estimation::RobustFit: find the pose whose homography from the reference to the
/// image is nearest to a given homography. `whitening` weights the differences of the entries with
/// the covariance of the given homography.
struct PoseProblem {
  using State = Eigen::Isometry3d;

  Vector8 wanted;  // first eight entries of the given homography
  util::SmallMatrix whitening;
  Eigen::Matrix3d camera, target_from_reference;
  int parameters = 6;  // number of fitted parameters; 3 if the rotation is held fixed

  /// The pose after a step. The first three entries of the step move the target in x, y and z, in
  /// units of its distance z. The last three rotate it about its own origin, with axes parallel to
  /// the camera's axes, rad.
  static Eigen::Isometry3d moved(const Eigen::Isometry3d& pose, const estimation::Step& step) {
    Eigen::Isometry3d out = pose;
    if (step.size() > 3) out.linear() = util::rotationAbout(step.tail<3>()) * pose.linear();
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
    // Step of the finite differences, in the units of moved(). With this step, they are accurate to
    // 1e-10.
    constexpr double kStep = 1e-6;
    util::SmallMatrix slope(8, parameters);
    for (int i = 0; i < parameters; ++i) {
      const estimation::Step step = kStep * estimation::Step::Unit(parameters, i);
      slope.col(i) = (entriesOf(moved(pose, step)) - entriesOf(moved(pose, -step))) / (2.0 * kStep);
    }
    const Vector8 rest = entriesOf(pose) - wanted;
    estimation::setLeastSquares(util::times(whitening, rest), util::times(whitening, slope), sums);
  }
};

/// Fits a pose, starting at `pose`. Empty if the fit does not converge, or if the target is then
/// behind the camera or turned away.
std::optional<PlanarPose> fitFrom(Eigen::Isometry3d pose, PoseProblem problem) {
  estimation::FitRules rules;
  rules.most_steps = 300;  // many, because with large errors the fit zigzags in short steps
  // The fit has converged if no entry of a step is larger: rad for the rotation, share of the
  // distance for the position.
  rules.converged = 1e-7;
  rules.first_damping = 1e-3;
  estimation::RobustFit<const PoseProblem> fit;
  if (fit.minimise(problem, rules, pose) != estimation::FitEnd::converged || !isSeen(pose))
    return std::nullopt;
  problem.parameters = 6;
  estimation::RobustWeights weights;
  estimation::NormalEquations sums;
  problem.linearise(pose, weights, sums);
  Vector6 units = Vector6::Ones();
  units.head<3>().setConstant(pose.translation().z());
  PlanarPose found;
  found.target_to_camera = pose;
  found.covariance = units.asDiagonal() * estimation::inverseOf(sums.squares) * units.asDiagonal();
  found.squared_error = sums.cost;
  if (!found.covariance.allFinite()) return std::nullopt;
  return found;
}

/// The rotation about the camera's axes that turns `from` into `to`, as a rotation vector, rad.
Eigen::Vector3d rotationBetween(const Eigen::Matrix3d& from, const Eigen::Matrix3d& to) {
  const Eigen::AngleAxisd between(Eigen::Matrix3d(to * from.transpose()));
  return between.angle() * between.axis();
}

/// Returns the second pose of an ambiguous view. If the errors are large, the fits from both starts
/// may end at the same pose `found`, although a start (a solution of IPPE) outside the covariance
/// of `found` explains the homography nearly as well. For this start, the function keeps the
/// rotation and fits only the position. Empty if there is no such start.
std::optional<PlanarPose> poseOfRivalStart(const PlanarPose& found, const PoseProblem& problem,
                                           const std::vector<Eigen::Isometry3d>& starts) {
  constexpr double kReached = 11.34;  // 99 % quantile of chi-square with three degrees of freedom
  const Eigen::Matrix3d rotation = found.target_to_camera.linear();
  const Eigen::Matrix3d reach =
      util::inverseOf(Eigen::Matrix3d(found.covariance.bottomRightCorner<3, 3>()));
  const Eigen::Isometry3d* rival = nullptr;
  double farthest = kReached;
  for (const Eigen::Isometry3d& start : starts) {
    const Eigen::Vector3d turn = rotationBetween(rotation, start.linear());
    const double distance = turn.dot(reach * turn);
    if (distance > farthest) {
      farthest = distance;
      rival = &start;
    }
  }
  if (rival == nullptr) return std::nullopt;
  PoseProblem held = problem;
  held.parameters = 3;
  return fitFrom(*rival, held);
}

/// Returns the matrix W for which W covariance W' is the identity. The entries of a homography
/// differ in size by five orders of magnitude, so each entry is first divided by its standard
/// deviation.
std::optional<util::SmallMatrix> whiteningOf(const Covariance8& covariance) {
  const Vector8 deviation = covariance.diagonal().cwiseSqrt();
  if (!deviation.allFinite() || !(deviation.minCoeff() > 0.0)) return std::nullopt;
  const Covariance8 correlation =
      deviation.cwiseInverse().asDiagonal() * covariance * deviation.cwiseInverse().asDiagonal();
  const auto whitening = util::whiteningOf(correlation);
  if (!whitening) return std::nullopt;
  return util::SmallMatrix(*whitening * deviation.cwiseInverse().asDiagonal());
}

// The scale of the errors is unknown, because the covariance does not include the effect of a wrong
// K, or of a reference image whose proportions differ from the target's. So the scale is estimated,
// with a prior that counts as much as kPrior measurements and says that the covariance is right.
// The likelihood of a pose is then a Student's t density of its squared error. With kPrior = 1, the
// 50, 75 and 90 % quantiles of the squared error should be 3, 15 and 99; in the frames of a real
// video, they were 5, 21 and 71.
constexpr double kPrior = 1.0;
constexpr double kFreedom = 2.0;  // degrees of freedom: eight of H minus six of a pose

/// Sorts two poses by their likelihood and sets PlanarPose::share. Removes the second pose if it is
/// much less likely than the first.
void setShares(std::vector<PlanarPose>& poses) {
  constexpr double kLeastShare = 0.001;  // a second pose with a smaller share is removed
  if (poses.size() < 2) return;
  if (poses[1].squared_error < poses[0].squared_error) std::swap(poses[0], poses[1]);
  const double ratio = (kPrior + poses[0].squared_error) / (kPrior + poses[1].squared_error);
  poses[1].share = 1.0 - 1.0 / (1.0 + std::pow(ratio, 0.5 * (kPrior + kFreedom)));
  poses[0].share = 1.0 - poses[1].share;
  if (poses[1].share >= kLeastShare) return;
  poses[0].share = 1.0;
  poses.pop_back();
}

/// Fits a pose from each start. If this gives only one pose, for example because both fits end at
/// the same pose, adds the pose of poseOfRivalStart(), if there is one.
std::vector<PlanarPose> posesFrom(const std::vector<Eigen::Isometry3d>& starts,
                                  const PoseProblem& problem) {
  constexpr double kSame = 1e-4;  // rad
  std::vector<PlanarPose> poses;
  for (const Eigen::Isometry3d& start : starts) {
    const auto pose = fitFrom(start, problem);
    if (!pose) continue;
    if (poses.empty() ||
        rotationBetween(poses[0].target_to_camera.linear(), pose->target_to_camera.linear())
                .norm() >= kSame) {
      poses.push_back(*pose);
    }
  }
  if (poses.size() == 1) {
    if (const auto rival = poseOfRivalStart(poses[0], problem, starts)) poses.push_back(*rival);
  }
  return poses;
}

// Numbers of columns, rows and points of a grid that covers the reference image. A rolling shutter
// bends the image, so a homography must be fitted to points all over the image, not only to its
// corners.
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

/// Jacobian of the positions of the mapped points with respect to the first eight entries of the
/// homography.
util::SmallMatrix jacobianAt(const GridPoints& points, const Eigen::Matrix3d& homography) {
  util::SmallMatrix jacobian(2 * kGridPoints, 8);
  for (int i = 0; i < kGridPoints; ++i) {
    jacobian.middleRows<2>(Eigen::Index{2} * i) =
        homography::jacobianByEntries(homography, points.at(i));
  }
  return jacobian;
}

/// Fits `homography` by least squares so that it maps `points` to `wanted`. Takes Gauss-Newton
/// steps, so the given homography must already be near the result. Returns jacobianAt() of the
/// fitted homography.
util::SmallMatrix approach(const GridPoints& points, const GridPoints& wanted,
                           Eigen::Matrix3d& homography) {
  constexpr int kSteps = 3;
  util::SmallMatrix jacobian = jacobianAt(points, homography);
  for (int step = 0; step < kSteps; ++step) {
    util::SmallMatrix rest(2 * kGridPoints, 1);
    for (int i = 0; i < kGridPoints; ++i) {
      rest.middleRows<2>(Eigen::Index{2} * i) =
          wanted.at(i) - homography::project(homography, points.at(i));
    }
    const util::SmallMatrix change = util::leastSquares(jacobian, rest).solution;
    for (int i = 0; i < 8; ++i) homography(i / 3, i % 3) += change(i);
    jacobian = jacobianAt(points, homography);
  }
  return jacobian;
}

/// Adds the uncertainty due to the unknown readout time to the covariance of `now`. This error
/// stays the same from frame to frame while the motion stays the same, so it is added to the shared
/// covariance, too.
UncertainHomography withUnknownShutter(const UncertainHomography& now,
                                       const UncertainHomography& before, double seconds,
                                       const cv::Size& reference_size, int rows) {
  // An image is read out completely before the next image begins, so the readout time is within +-
  // `seconds`. The uniform distribution over this range has the deviation seconds / sqrt(3).
  const double deviation = std::min(util::kUnknownReadout, seconds / std::sqrt(3.0));
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
  result.poses = posesFrom(starts, problem);
  setShares(result.poses);
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
    by_now.middleRows<2>(Eigen::Index{2} * i) *= 1.0 - share;
    by_before.middleRows<2>(Eigen::Index{2} * i) *= share;
  }
  UncertainHomography answer = now;
  const util::SmallMatrix by_answer = approach(points, moved, answer.homography);
  by_now = util::leastSquares(by_answer, by_now).solution;
  by_before = util::leastSquares(by_answer, by_before).solution;
  // The smooth errors (shared_covariance) are about the same in both homographies, so they are
  // propagated as one common error; the noise of the two homographies is independent.
  const Covariance8 noise_now = now.covariance - now.shared_covariance;
  const Covariance8 noise_before = before.covariance - before.shared_covariance;
  answer.shared_covariance = util::propagated(by_now + by_before, now.shared_covariance);
  answer.covariance = answer.shared_covariance + Covariance8(util::propagated(by_now, noise_now)) +
                      Covariance8(util::propagated(by_before, noise_before));
  return answer;
}

}  // namespace ktgp_orb
