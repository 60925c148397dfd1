#include "motion/ground_filter.h"

#include <Eigen/LU>
#include <algorithm>

#include "estimation/robust_fit.h"
#include "util/constants.h"

namespace ktgp_orb::motion {

using util::inverseOf;
using util::leastSquares;
using util::propagated;
using util::times;
using util::whiteningOf;

namespace {

/// The problem for estimation::RobustFit: find the pose for which imageFromGround(pose) * map is
/// nearest to the measured homography, in units of the standard deviations of the entries.
struct PoseProblem {
  using State = CameraPose;
  Vector8 seen;  // entries of the measured homography
  SmallMatrix whitening;
  Eigen::Matrix3d map;

  /// The position part of a step is in units of the height.
  static CameraPose moved(const CameraPose& pose, const estimation::Step& step) {
    Vector6 change = step;
    change.head<3>() *= pose.position.z();
    return motion::moved(pose, change);
  }
  void linearise(const CameraPose& pose, estimation::RobustWeights& /*all 1*/,
                 estimation::NormalEquations& sums) const {
    const Eigen::Matrix3d h = imageFromGround(pose) * map;
    Matrix86 slope = byPose(h, map, pose);
    slope.leftCols<3>() *= pose.position.z();
    const Vector8 rest = entriesOf(h) - seen;
    estimation::setLeastSquares(times(whitening, rest), times(whitening, slope), sums);
  }
};

/// The most likely pose if `seen` is the homography from the keyframe to the image and `map` maps
/// the keyframe to the ground; empty if no pose fits.
std::optional<CameraPose> fitted(const Eigen::Matrix3d& seen, const SmallMatrix& whitening,
                                 const Eigen::Matrix3d& map) {
  auto pose = poseFrom(seen * map.inverse());
  if (!pose) return std::nullopt;
  estimation::FitRules rules;
  rules.most_steps = 8;    // upper limit; three steps are enough if the start is near
  rules.converged = 1e-9;  // in rad for the rotation, and as a share of the height for the position
  rules.longest = 0.5;
  const PoseProblem problem{entriesOf(seen), whitening, map};
  estimation::RobustFit<const PoseProblem> fit;
  if (fit.minimise(problem, rules, *pose) == estimation::FitEnd::undetermined ||
      !(pose->position.z() > 0.0)) {
    return std::nullopt;
  }
  return pose;
}

}  // namespace

void GroundFilter::setReadout(double seconds) {
  constexpr double kShare = 0.1;  // deviation of a given readout time, as a share of this time
  is_known_ = seconds != -1.0;
  readout_ = is_known_ ? seconds : 0.0;
  allowed_ = 0.0;
  const double deviation = kShare * std::abs(readout_);  // 0 if unknown; see allowReadout()
  covariance_.row(kReadout).setZero();
  covariance_.col(kReadout).setZero();
  covariance_(kReadout, kReadout) = deviation * deviation;
}

/// An unknown readout time is between -r and r. Here r is the time between two images, but at most
/// 1/30 s, since nearly every camera can take 30 images a second, and reads an image out in less
/// than this time.
void GroundFilter::allowReadout(double seconds) {
  constexpr double kLongest = 1.0 / 30.0;  // s
  // r² divided by the variance of a uniform distribution over [-r, r]
  constexpr double kUniform = 3.0;
  const double longest = std::min(seconds, kLongest);
  if (is_known_ || !(longest > allowed_)) return;
  covariance_(kReadout, kReadout) += (longest * longest - allowed_ * allowed_) / kUniform;
  allowed_ = longest;
}

void GroundFilter::limitReadout() {
  const double beyond = std::abs(readout_) - allowed_;
  if (is_known_ || !(beyond > 0.0)) return;
  // The bound is not a measurement, so it must not reduce the covariance. Otherwise the filter
  // would soon be certain of a readout time at the bound.
  const double back = readout_ > 0.0 ? -beyond : beyond;
  correct(back / covariance_(kReadout, kReadout) * covariance_.col(kReadout));
}

void GroundFilter::start(const CameraPose& pose, const Matrix6& covariance) {
  frame_position_.setZero();
  frame_yaw_ = 0.0;
  map_.setIdentity();
  now_ = before_ = pose;
  const double readout_variance = covariance_(kReadout, kReadout);
  covariance_.setZero();
  covariance_(kReadout, kReadout) = readout_variance;
  covariance_.block<6, 6>(kNow, kNow) = covariance;
  moveFrame();
}

/// Moves the origin of the filter's frame to the ground below the newest pose. The errors of x, y
/// and yaw of this pose thus become errors of the frame. Drops the states of the map and of the
/// previous pose.
void GroundFilter::moveFrame() {
  const Eigen::Matrix3d turn = aboutUp(frame_yaw_);
  const Eigen::Vector3d way = turn * Eigen::Vector3d(now_.position.x(), now_.position.y(), 0.0);
  const Eigen::RowVector3d up = now_.axes.row(2);
  StateCovariance slope = StateCovariance::Zero();
  slope.topLeftCorner<4, 4>().setIdentity();  // frame and readout time are kept
  slope(0, 2) = -way.y();
  slope(1, 2) = way.x();
  slope.block<2, 2>(kFrame, kNow) = turn.topLeftCorner<2, 2>();
  slope.block<1, 3>(kFrame + 2, kNow + 3) = up;
  slope(kNow + 2, kNow + 2) = 1.0;
  slope.bottomRightCorner<3, 3>() = Eigen::Matrix3d::Identity() - up.transpose() * up;
  covariance_ = propagated(slope, covariance_);
  frame_position_ += way.head<2>();
  now_.position.head<2>().setZero();
}

void GroundFilter::predict(const Vector6& twist, const Matrix6& twist_covariance, double seconds,
                           const GroundMotionOptions& options) {
  // After a long pause, the last velocity tells nothing about the pose, which is then not known at
  // all. Variances that grew further would only make the covariance indefinite by rounding.
  constexpr double kLongest = 60.0;     // s
  constexpr double kFarthest = 1000.0;  // m
  seconds = std::min(seconds, kLongest);
  const CameraPose last = pose();
  const Eigen::Matrix3d turn = rotationAbout(seconds * twist.tail<3>());
  const CameraPose next{last.axes * turn, last.position + seconds * (last.axes * twist.head<3>())};
  Matrix6 by_pose = Matrix6::Identity();
  by_pose.topRightCorner<3, 3>() = -seconds * last.axes * crossed(twist.head<3>());
  by_pose.bottomRightCorner<3, 3>() = turn.transpose();
  Matrix6 by_twist = seconds * Matrix6::Identity();
  by_twist.topLeftCorner<3, 3>() *= last.axes;
  Matrix6 predicted = propagated(by_pose, covariance()) + propagated(by_twist, twist_covariance);
  const double half_square = 0.5 * seconds * seconds;
  predicted.diagonal().head<3>().array() += std::pow(half_square * options.acceleration, 2);
  predicted.diagonal().tail<3>().array() += std::pow(half_square * options.turn_acceleration, 2);
  Vector6 largest;  // standard deviations
  largest << Eigen::Vector3d::Constant(kFarthest), Eigen::Vector3d::Constant(util::kPi);
  // A pose that was given with a larger deviation keeps it.
  largest = largest.cwiseMax(covariance().diagonal().cwiseMax(0.0).cwiseSqrt());
  const Vector6 kept = largest.cwiseQuotient(predicted.diagonal().cwiseSqrt()).cwiseMin(1.0);
  start(next, kept.asDiagonal() * predicted * kept.asDiagonal());
}

void GroundFilter::moveBase(const Pose3& base, const Covariance6& covariance_of_base,
                            const Pose3& base_to_camera) {
  const CameraPose last = pose();
  CameraPose moved = last;
  const double yaw_now = yawOf(moved.axes * base_to_camera.linear());
  moved.axes = aboutUp(yawOf(base.linear()) - yaw_now) * moved.axes;
  const Eigen::Vector3d lever = moved.axes * base_to_camera.translation();
  moved.position.head<2>() = (base.translation() - lever).head<2>();
  Matrix6 to_axes_of_ground = Matrix6::Identity();
  to_axes_of_ground.bottomRightCorner<3, 3>() = last.axes;
  Matrix6 both = propagated(to_axes_of_ground, covariance());
  for (const int i : {0, 1, 5}) {
    both.row(i).setZero();
    both.col(i).setZero();
  }
  for (const int i : {0, 1, 5}) {
    for (const int j : {0, 1, 5}) both(i, j) = covariance_of_base(i, j);
  }
  // So far, x and y of `both` are those of the base. An error of the rotation moves the camera
  // relative to the base.
  Matrix6 to_camera = Matrix6::Identity();
  to_camera.topRightCorner<2, 3>() = crossed(lever).topRows<2>();
  both = propagated(to_camera, both);
  to_axes_of_ground.bottomRightCorner<3, 3>() = moved.axes;
  start(moved, propagated(to_axes_of_ground.transpose(), both));
}

CameraPose GroundFilter::pose() const {
  const Eigen::Matrix3d turn = aboutUp(frame_yaw_);
  CameraPose pose{turn * now_.axes, turn * now_.position};
  pose.position.head<2>() += frame_position_;
  return pose;
}

void GroundFilter::report(const Eigen::Vector3d& origin, const GroundMotionOptions& options,
                          GroundEstimate& estimate) const {
  const CameraPose camera = pose();
  const Eigen::Matrix3d& axes = camera.axes;
  const Pose3 base_to_camera = options.camera_to_base.inverse();
  const Eigen::Vector3d lever = base_to_camera.translation();
  estimate.height = camera.position.z();
  estimate.base_to_odometry.linear() = axes * base_to_camera.linear();
  estimate.base_to_odometry.translation() = camera.position + axes * lever;
  Matrix6 slope = Matrix6::Identity();
  slope.topRightCorner<3, 3>() = -axes * crossed(lever);
  slope.bottomRightCorner<3, 3>() = axes;
  const double scale_variance = options.scale_deviation * options.scale_deviation;
  // An error of the scale changes the path of the camera, but not the lever.
  const Eigen::Vector3d way = camera.position - origin;
  estimate.pose_covariance = propagated(slope, covariance());
  estimate.pose_covariance.topLeftCorner<3, 3>() += scale_variance * way * way.transpose();
}

Matrix6 GroundFilter::covariance() const {
  const Eigen::Matrix3d turn = aboutUp(frame_yaw_);
  const Eigen::Vector3d way = turn * now_.position;
  Eigen::Matrix<double, 6, 9> slope = Eigen::Matrix<double, 6, 9>::Zero();
  slope.topLeftCorner<2, 2>().setIdentity();
  slope(0, 2) = -way.y();
  slope(1, 2) = way.x();
  slope.block<3, 1>(3, 2) = now_.axes.row(2).transpose();
  slope.block<3, 3>(0, 3) = turn;
  slope.bottomRightCorner<3, 3>().setIdentity();
  Eigen::Matrix<double, 9, 9> both;
  both << covariance_.block<3, 3>(kFrame, kFrame), covariance_.block<3, 6>(kFrame, kNow),
      covariance_.block<6, 3>(kNow, kFrame), covariance_.block<6, 6>(kNow, kNow);
  return propagated(slope, both);
}

double GroundFilter::tiltDeviation() const {
  const Eigen::Matrix3d turn =
      now_.axes * covariance().bottomRightCorner<3, 3>() * now_.axes.transpose();
  return std::sqrt(std::max(turn(0, 0), turn(1, 1)));
}

Eigen::Matrix<double, 12, 12> GroundFilter::noiseOfBoth() const {
  const Vector8 scale = covariance_.diagonal().segment<8>(kMap).cwiseSqrt().cwiseInverse();
  const Matrix8 map = scale.asDiagonal() * covariance_.block<8, 8>(kMap, kMap) * scale.asDiagonal();
  const Eigen::Matrix<double, 8, 12> by_map =
      scale.asDiagonal() * covariance_.block<8, 12>(kMap, kBefore);
  const auto whitening = whiteningOf(map);
  if (!whitening) return covarianceOfBoth();
  const SmallMatrix known = times(*whitening, by_map);
  return covarianceOfBoth() - times(known.transpose(), known);
}

/// The homography without the effect of the rolling shutter, according to the present estimate of
/// the readout time.
Eigen::Matrix3d GroundFilter::straightened(const ImageMotion& motion) const {
  Eigen::Matrix<double, 3, 3, Eigen::RowMajor> h = motion.homography;
  Eigen::Map<Vector8>(h.data()) += readout_ * motion.by_readout;
  return h;
}

/// Updates the covariance: the part of the state that starts at `begin` becomes `slope` times the
/// state plus noise with the covariance `noise`.
void GroundFilter::replace(int begin, const SmallRef& slope, const SmallRef& noise) {
  const Eigen::Index n = slope.rows();
  covariance_.middleRows(begin, n) = times(slope, covariance_);
  covariance_.middleCols(begin, n) = covariance_.middleRows(begin, n).transpose().eval();
  covariance_.block(begin, begin, n, n) = times(slope, covariance_.middleCols(begin, n)) + noise;
}

void GroundFilter::setKeyframe(const ImageMotion& motion, bool at_reference) {
  moveFrame();
  const Eigen::Matrix3d from_keyframe =
      at_reference ? Eigen::Matrix3d::Identity() : straightened(motion);
  map_ = imageFromGround(now_).inverse() * from_keyframe;
  map_ /= map_.norm();
  const Eigen::Matrix3d h = imageFromGround(now_) * map_;
  const Matrix8 by_homography = mapFromEntries(from_keyframe);
  Eigen::Matrix<double, 8, kSize> slope = Eigen::Matrix<double, 8, kSize>::Zero();
  slope.middleCols<6>(kNow) = -times(mapFromEntries(h), byPose(h, map_, now_));
  if (!at_reference) slope.col(kReadout) = by_homography * motion.by_readout;
  replace(kMap, slope,
          kOfKeyframe * propagated(mapFromEntries(motion.homography), motion.covariance));
}

std::optional<Innovation> GroundFilter::advance(const ImageMotion& motion) {
  const GroundFilter before = *this;
  if (!fit(motion, 1.0)) return std::nullopt;
  const Innovation innovation = innovationOf(constraints_, constraints_by_state_, 1.0);
  const double noise = studentNoise(innovation.misfit, 2);
  if (noise > 1.0) {
    *this = before;
    if (!fit(motion, noise)) {
      *this = before;
      return std::nullopt;
    }
  }
  update(constraints_, constraints_by_state_, 1.0);
  return innovation;
}

/// Fits a pose to the homography of the new frame and makes it the newest pose. Sets constraints_
/// and constraints_by_state_ to the two constraints that the pose does not use up. `noise`: factor
/// on the variances of the homography. Returns false if no pose fits.
bool GroundFilter::fit(const ImageMotion& motion, double noise) {
  const auto whitening = whiteningOf(noise * kOfFrame * motion.covariance);
  if (!whitening) return false;
  const Eigen::Matrix3d seen = straightened(motion);
  const auto found = fitted(seen, *whitening, map_);
  if (!found) return false;
  const CameraPose& pose = *found;

  // The error of the new pose depends on the errors of the readout time and the map, and on the
  // noise of the homography. First column: residual of the homography. Other columns: its
  // derivatives with respect to the errors of the readout time and the map.
  const Eigen::Matrix3d h = imageFromGround(pose) * map_;
  Eigen::Matrix<double, 8, 10> residual_and_slope;
  residual_and_slope << entriesOf(seen) - entriesOf(h), -motion.by_readout, byMap(h);
  const SmallMatrix by_pose = times(*whitening, byPose(h, map_, pose));
  const util::LeastSquares solved = leastSquares(by_pose, times(*whitening, residual_and_slope));
  constraints_ = solved.rest.col(0);
  constraints_by_state_.middleCols<9>(kReadout) = solved.rest.rightCols(9);
  // In a straight flight, the readout time cannot be seen in the images. Over many frames, however,
  // the filter would mistake noise of the image flow (see Shutter) for information on the readout
  // time. So the readout time is corrected only if a typical readout time (kUnknownReadout) would
  // change the constraints by more than their noise.
  if (constraints_by_state_.col(kReadout).norm() * util::kUnknownReadout < 1.0) {
    constraints_by_state_.col(kReadout).setZero();
  }
  Eigen::Matrix<double, 6, kSize> slope = Eigen::Matrix<double, 6, kSize>::Zero();
  slope.middleCols<9>(kReadout) = -solved.solution.rightCols(9);

  before_ = now_;
  now_ = pose;
  Eigen::Matrix<double, 6, kSize> same = Eigen::Matrix<double, 6, kSize>::Zero();
  same.middleCols<6>(kNow).setIdentity();
  replace(kBefore, same, Matrix6::Zero());
  replace(kNow, slope, inverseOf(times(by_pose.transpose(), by_pose)));
  return true;
}

std::optional<SeenTurn> GroundFilter::turnSinceKeyframe(const ImageMotion& motion) const {
  const auto keyframe = poseFrom(map_.inverse());
  const auto whitening = whiteningOf(motion.covariance);
  if (!keyframe || !whitening) return std::nullopt;
  const Eigen::Matrix3d map = imageFromGround(*keyframe).inverse();
  const auto pose = fitted(straightened(motion), *whitening, map);
  if (!pose) return std::nullopt;
  const Eigen::Matrix3d h = imageFromGround(*pose) * map;
  const SmallMatrix by_pose = times(*whitening, byPose(h, map, *pose));
  const Matrix6 covariance = inverseOf(times(by_pose.transpose(), by_pose));
  const Eigen::Matrix3d same = Eigen::Matrix3d::Identity();
  const Matrix86 by_keyframe =
      // Jacobian of the entries of h with respect to a step of the keyframe's pose.
      -byMap(h) * (mapFromEntries(same) * byPose(same, map, *keyframe));
  const Matrix6 follows =
      // Jacobian of the newest pose with respect to a step of the keyframe's pose.
      -leastSquares(by_pose, times(*whitening, by_keyframe)).solution;
  SeenTurn seen{keyframe->axes.transpose() * pose->axes, covariance.bottomRightCorner<3, 3>()};
  seen.by_tilt = follows.bottomRightCorner<3, 3>() - seen.rotation.transpose();
  return seen;
}

Innovation GroundFilter::innovationOf(const SmallRef& residual, const SmallRef& slope,
                                      double variance) const {
  SmallMatrix expected = propagated(slope, covariance_);
  const double known = expected.trace();
  expected.diagonal().array() += variance;
  const double square = propagated(residual.transpose(), inverseOf(expected))(0, 0);
  const auto dimensions = static_cast<double>(residual.rows());
  return {std::sqrt(square), (residual.squaredNorm() - known) / (dimensions * variance)};
}

/// Kalman update for readings whose noise follows Student's t distribution: if a reading differs
/// from its prediction by more than normal noise, its variance is enlarged, so that an outlier does
/// little harm.
void GroundFilter::update(const SmallRef& residual, const SmallRef& slope, double variance) {
  const double misfit = innovationOf(residual, slope, variance).misfit;
  if (!std::isfinite(misfit)) return;
  const double noise = variance * studentNoise(misfit, static_cast<int>(residual.rows()));
  const SmallMatrix cross_covariance = times(covariance_, slope.transpose());
  SmallMatrix expected = times(slope, cross_covariance);
  expected.diagonal().array() += noise;
  const SmallMatrix gain = times(cross_covariance, inverseOf(expected));
  correct(times(gain, residual));
  // Joseph's form of the new covariance, (I - K S) P (I - K S)' + K R K', with K: `gain`, S:
  // `slope`, P: the old covariance, R: the noise of the reading. With the short form, (I - K S) P,
  // rounding would make the matrix indefinite if a reading is nearly exact.
  covariance_ -= times(gain, cross_covariance.transpose());
  covariance_ -= times(times(covariance_, slope.transpose()), gain.transpose());
  covariance_ += noise * times(gain, gain.transpose());
  covariance_ = (0.5 * (covariance_ + covariance_.transpose())).eval();
}

namespace {

/// Rotates the pose by the rotation vector `turn` (rad) about the keyframe's position `center`.
/// Then scales its position by 1 + `scale`, seen from the origin of the filter's frame.
CameraPose withGround(const CameraPose& pose, const Eigen::Vector3d& turn, double scale,
                      const Eigen::Vector3d& center) {
  const Eigen::Matrix3d rotation = rotationAbout(turn);
  return {rotation * pose.axes, (1.0 + scale) * (center + rotation * (pose.position - center))};
}

}  // namespace

/// The change of the state, to first order, if the whole ground is rotated about the keyframe by
/// the rotation vector `turn` (rad) and is scaled by 1 + `scale`. The previous and the newest pose
/// move with the ground, so the images do not change.
GroundFilter::State GroundFilter::groundStep(const Eigen::Vector3d& turn, double scale,
                                             const CameraPose& keyframe) const {
  const auto step_of = [&](const CameraPose& pose) {
    Vector6 step;
    step << turn.cross(pose.position - keyframe.position) + scale * pose.position,
        pose.axes.transpose() * turn;
    return step;
  };
  const Eigen::Matrix3d h = imageFromGround(keyframe) * map_;
  State step = State::Zero();
  step.segment<8>(kMap) = -(mapFromEntries(h) * (byPose(h, map_, keyframe) * step_of(keyframe)));
  step.segment<6>(kBefore) = step_of(before_);
  step.segment<6>(kNow) = step_of(now_);
  return step;
}

void GroundFilter::widen(double scale_variance, double tilt_variance) {
  if (scale_variance == 0.0 && tilt_variance == 0.0) return;
  const auto keyframe = poseFrom(map_.inverse());
  if (!keyframe) return;
  const auto add = [&](const Eigen::Vector3d& turn, double scale) {
    const State step = groundStep(turn, scale, *keyframe);
    covariance_ += step * step.transpose();
  };
  add(Eigen::Vector3d::Zero(), std::sqrt(scale_variance));
  for (const int axis : {0, 1}) add(std::sqrt(tilt_variance) * Eigen::Vector3d::Unit(axis), 0.0);
}

/// Adds the correction `error` to the state. The tilt and the scale of the ground are far less
/// certain than the relative poses of the frames, in the first frames by a factor of a thousand. A
/// correction of tilt and scale is often too large for a first-order step, so it is applied
/// exactly. Only the rest of the correction is added to first order.
void GroundFilter::correct(const State& error) {
  State left = error;
  if (const auto keyframe = poseFrom(map_.inverse())) {
    const Eigen::Vector3d center = keyframe->position;
    Eigen::Vector3d turn = now_.axes * error.tail<3>();
    turn.z() = 0.0;
    const double rise = error(kNow + 2) - turn.cross(now_.position - center).z();
    const double scale = rise / now_.position.z();
    left -= groundStep(turn, scale, *keyframe);
    const Eigen::Matrix3d h = imageFromGround(*keyframe) * map_;
    map_ = imageFromGround(withGround(*keyframe, turn, scale, center)).inverse() * h;
    map_ /= map_.norm();
    before_ = withGround(before_, turn, scale, center);
    now_ = withGround(now_, turn, scale, center);
  }
  frame_position_ += left.segment<2>(kFrame);
  frame_yaw_ += left(kFrame + 2);
  readout_ += left(kReadout);
  const Eigen::Matrix<double, 9, 1> entries =
      (Eigen::Matrix<double, 9, 1>() << left.segment<8>(kMap), 0.0).finished();
  map_ += map_ * Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(entries.data());
  before_ = moved(before_, left.segment<6>(kBefore));
  now_ = moved(now_, left.segment<6>(kNow));
}

}  // namespace ktgp_orb::motion
