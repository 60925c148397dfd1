#include "motion/ground_filter.h"

#include <Eigen/LU>
#include <cmath>

namespace ktgp_orb::motion {

using util::inverseOf;
using util::LeastSquares;
using util::leastSquares;
using util::propagated;
using util::times;
using util::whiteningOf;

namespace {

/// The shares of the covariance of a homography that belong to the image of the keyframe, the same
/// for all frames after it, and to the other image. Measured on exact flights.
constexpr double kOfKeyframe = 0.6;
constexpr double kOfFrame = 0.4;

}  // namespace

void GroundFilter::start(const CameraPose& pose, const Matrix6& covariance) {
  frame_position_.setZero();
  frame_yaw_ = 0.0;
  map_.setIdentity();
  now_ = before_ = pose;
  covariance_.setZero();
  covariance_.block<6, 6>(kNow, kNow) = covariance;
  moveFrame();
}

/// Puts the frame below the newest pose: the errors of x, y and yaw of the pose become its errors.
/// What belongs to the map and to the pose before is lost.
void GroundFilter::moveFrame() {
  const Eigen::Matrix3d turn = rotationAbout(frame_yaw_ * Eigen::Vector3d::UnitZ());
  const Eigen::Vector3d way = turn * Eigen::Vector3d(now_.position.x(), now_.position.y(), 0.0);
  const Eigen::RowVector3d up = now_.axes.row(2);
  Eigen::Matrix<double, 9, 9> slope = Eigen::Matrix<double, 9, 9>::Identity();
  slope.block<2, 2>(0, 3) = turn.topLeftCorner<2, 2>();  // of the frame by the pose
  slope(0, 2) = -way.y();
  slope(1, 2) = way.x();
  slope.block<1, 3>(2, 6) = up;
  slope.block<2, 2>(3, 3).setZero();  // of the pose
  slope.block<3, 3>(6, 6) -= up.transpose() * up;
  Eigen::Matrix<double, 9, 9> both;
  both << covariance_.block<3, 3>(kFrame, kFrame), covariance_.block<3, 6>(kFrame, kNow),
      covariance_.block<6, 3>(kNow, kFrame), covariance_.block<6, 6>(kNow, kNow);
  both = propagated(slope, both);
  covariance_.setZero();
  covariance_.block<3, 3>(kFrame, kFrame) = both.topLeftCorner<3, 3>();
  covariance_.block<3, 6>(kFrame, kNow) = both.topRightCorner<3, 6>();
  covariance_.block<6, 3>(kNow, kFrame) = both.bottomLeftCorner<6, 3>();
  covariance_.block<6, 6>(kNow, kNow) = both.bottomRightCorner<6, 6>();
  frame_position_ += way.head<2>();
  now_.position.head<2>().setZero();
}

CameraPose GroundFilter::pose() const {
  const Eigen::Matrix3d turn = rotationAbout(frame_yaw_ * Eigen::Vector3d::UnitZ());
  CameraPose pose{turn * now_.axes, turn * now_.position};
  pose.position.head<2>() += frame_position_;
  return pose;
}

Matrix6 GroundFilter::covariance() const {
  const Eigen::Matrix3d turn = rotationAbout(frame_yaw_ * Eigen::Vector3d::UnitZ());
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

void GroundFilter::setKeyframe(const ImageMotion& motion, bool at_reference) {
  moveFrame();
  const Eigen::Matrix3d from_keyframe =
      at_reference ? Eigen::Matrix3d::Identity() : motion.homography;
  map_ = imageFromGround(now_).inverse() * from_keyframe;
  map_ /= map_.norm();
  const Eigen::Matrix3d h = imageFromGround(now_) * map_;
  const Matrix86 by_pose = -times(mapFromEntries(h), byPose(h, map_, now_));
  const Matrix8 by_noise = mapFromEntries(motion.homography);
  covariance_.middleRows<8>(kMap) = times(by_pose, covariance_.middleRows<6>(kNow));
  covariance_.middleCols<8>(kMap) = covariance_.middleRows<8>(kMap).transpose().eval();
  covariance_.block<8, 8>(kMap, kMap) = propagated(by_pose, covariance_.block<6, 6>(kNow, kNow)) +
                                        kOfKeyframe * propagated(by_noise, motion.covariance);
}

bool GroundFilter::advance(const ImageMotion& motion) {
  const auto whitening = whiteningOf(kOfFrame * motion.covariance);
  const auto start = poseFrom(motion.homography * map_.inverse());
  if (!start || !whitening) return false;
  CameraPose pose = *start;
  for (int iteration = 0; iteration < 5; ++iteration) {
    const Eigen::Matrix3d h = imageFromGround(pose) * map_;
    const Vector8 residual = entriesOf(motion.homography) - entriesOf(h);
    const Vector6 step =
        leastSquares(times(*whitening, byPose(h, map_, pose)), times(*whitening, residual))
            .solution;
    if (!step.allFinite() || step.tail<3>().norm() > 0.5) return false;
    pose = moved(pose, step);
    if (step.norm() < 1e-9 * pose.position.z()) break;
  }
  if (!(pose.position.z() > 0.0)) return false;

  // The new pose follows the map and the noise; the homography has two more numbers.
  const Eigen::Matrix3d h = imageFromGround(pose) * map_;
  Eigen::Matrix<double, 8, 9> residual_and_map;
  residual_and_map << entriesOf(motion.homography) - entriesOf(h), byMap(h);
  const SmallMatrix by_pose = times(*whitening, byPose(h, map_, pose));
  const LeastSquares fit = leastSquares(by_pose, times(*whitening, residual_and_map));
  const Eigen::Matrix<double, 6, 8> pose_by_map = -fit.solution.rightCols(8);
  rest_ = fit.rest.col(0);
  rest_by_map_ = fit.rest.rightCols(8);

  before_ = now_;
  now_ = pose;
  covariance_.middleRows<6>(kBefore) = covariance_.middleRows<6>(kNow).eval();
  covariance_.middleCols<6>(kBefore) = covariance_.middleCols<6>(kNow).eval();
  covariance_.middleRows<6>(kNow) = times(pose_by_map, covariance_.middleRows<8>(kMap));
  covariance_.middleCols<6>(kNow) = covariance_.middleRows<6>(kNow).transpose().eval();
  covariance_.block<6, 6>(kNow, kNow) =
      propagated(pose_by_map, covariance_.block<8, 8>(kMap, kMap)) +
      inverseOf(times(by_pose.transpose(), by_pose));
  return true;
}

double GroundFilter::useRest(double limit) {
  Eigen::Matrix<double, 2, kSize> slope = Eigen::Matrix<double, 2, kSize>::Zero();
  slope.middleCols<8>(kMap) = rest_by_map_;
  return update(rest_, slope, 1.0, limit);
}

double GroundFilter::use(const TurnReading& reading, double limit) {
  Eigen::Matrix<double, 3, 6> slope_before;
  const PoseRows<3> rows = rowsOf(reading, now_, before_, slope_before);
  Eigen::Matrix<double, 3, kSize> slope = Eigen::Matrix<double, 3, kSize>::Zero();
  slope.middleCols<6>(kBefore) = slope_before;
  slope.rightCols<6>() = rows.slope;
  return update(rows.residual, slope, rows.deviation * rows.deviation, limit);
}

double GroundFilter::update(const SmallRef& residual, const SmallRef& slope, double variance,
                            double limit) {
  const SmallMatrix cross_covariance = times(covariance_, slope.transpose());
  SmallMatrix expected = times(slope, cross_covariance);
  expected.diagonal().array() += variance;
  const SmallMatrix information = inverseOf(expected);
  const double misfit = std::sqrt(propagated(residual.transpose(), information)(0, 0));
  if (!(misfit <= limit)) return misfit;
  const SmallMatrix gain = times(cross_covariance, information);
  correct(times(gain, residual));
  // Joseph's form, (I - K S) P (I - K S)' + K R K': one factor alone rounds to an indefinite matrix
  // where readings are nearly exact.
  covariance_ -= times(gain, cross_covariance.transpose());
  covariance_ -= times(times(covariance_, slope.transpose()), gain.transpose());
  covariance_ += variance * times(gain, gain.transpose());
  covariance_ = (0.5 * (covariance_ + covariance_.transpose())).eval();
  return misfit;
}

/// Tilt and scale of the ground are less certain by far than how the frames lie to each other, in
/// the first frames by a thousand times. So the poses and the map follow them together, rotated
/// about the keyframe and scaled; only what is left is a linear step.
void GroundFilter::correct(const Eigen::Matrix<double, kSize, 1>& error) {
  frame_position_ += error.segment<2>(kFrame);
  frame_yaw_ += error(kFrame + 2);
  Vector8 entries = error.segment<8>(kMap);
  Vector6 of_before = error.segment<6>(kBefore);
  Vector6 of_now = error.segment<6>(kNow);
  if (const auto keyframe = poseFrom(map_.inverse())) {
    const Eigen::Vector3d center = keyframe->position;
    Eigen::Vector3d turn = now_.axes * of_now.tail<3>();
    turn.z() = 0.0;
    const double rise = of_now(2) - turn.cross(now_.position - center).z();
    const double scale = rise / now_.position.z();
    const auto linear = [&](const CameraPose& pose) {
      Vector6 step;
      step << turn.cross(pose.position - center) + scale * pose.position,
          pose.axes.transpose() * turn;
      return step;
    };
    const auto follow = [&](const CameraPose& pose) {
      const Eigen::Matrix3d rotation = rotationAbout(turn);
      return CameraPose{rotation * pose.axes,
                        (1.0 + scale) * (center + rotation * (pose.position - center))};
    };
    const Eigen::Matrix3d h = imageFromGround(*keyframe) * map_;
    entries += mapFromEntries(h) * (byPose(h, map_, *keyframe) * linear(*keyframe));
    of_before -= linear(before_);
    of_now -= linear(now_);
    map_ = imageFromGround(follow(*keyframe)).inverse() * h;
    map_ /= map_.norm();
    before_ = follow(before_);
    now_ = follow(now_);
  }
  const Eigen::Matrix<double, 9, 1> all =
      (Eigen::Matrix<double, 9, 1>() << entries, 0.0).finished();
  map_ += map_ * Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(all.data());
  before_ = moved(before_, of_before);
  now_ = moved(now_, of_now);
}

}  // namespace ktgp_orb::motion
