#pragma once

#include <Eigen/Core>

#include "core/util/small_matrix.h"
#include "motion/rows.h"

namespace ktgp_orb::motion {

using util::SmallMatrix;
using util::SmallRef;

/// The map of a keyframe, and the poses of the two newest frames, with their joint covariance: an
/// extended Kalman filter whose new pose is a weighted least-squares fit to the homography.
///
/// All poses are in a frame of the keyframe: its origin is below the keyframe, and x, y and yaw of
/// the keyframe are exact there. Where that frame is in the odometry, which gets less and less
/// certain, is a state of its own: in one frame for all, the derivatives of different times would
/// disagree, and that would turn the large uncertainty of x, y and yaw into wrong corrections.
class GroundFilter {
 public:
  /// Errors: x, y and yaw of the frame of the keyframe (3), E of the map (8), steps of the pose
  /// before (6) and of the pose now (6).
  static constexpr int kFrame = 0, kMap = 3, kBefore = 11, kNow = 17, kSize = 23;

  /// A pose in the odometry, without a map.
  void start(const CameraPose& pose, const Matrix6& covariance);
  /// Makes the reference of `motion` the keyframe. Its pose, if `at_reference`, or else that of the
  /// frame that `motion` leads to, is the pose now. `motion`: with all its covariance, of which a
  /// share belongs to the keyframe.
  void setKeyframe(const ImageMotion& motion, bool at_reference);
  /// The pose now becomes the one before, and `motion` leads from the keyframe to a new one. False,
  /// without any change: no pose fits.
  bool advance(const ImageMotion& motion);

  /// What the newest pose has beyond the six numbers of a pose, its two other numbers, tells about
  /// the map. Returns by how many standard deviations it differs from the expectation; nothing
  /// changes beyond `limit`. The same for readings of the newest pose.
  double useRest(double limit);
  template <int kRows>
  double use(const PoseRows<kRows>& rows, double limit) {
    Eigen::Matrix<double, kRows, kSize> slope = Eigen::Matrix<double, kRows, kSize>::Zero();
    slope.template rightCols<6>() = rows.slope;
    return update(rows.residual, slope, rows.deviation * rows.deviation, limit);
  }
  double use(const TurnReading& reading, double limit);

  /// In the frame of the keyframe.
  const CameraPose& now() const { return now_; }
  const CameraPose& before() const { return before_; }
  /// False where numbers were too large to compute with: nothing after that can be.
  bool isFinite() const { return now_.position.allFinite() && covariance_.allFinite(); }
  /// Adds to the covariance of the newest pose.
  void addCovariance(const Matrix6& more) { covariance_.bottomRightCorner<6, 6>() += more; }
  /// The newest pose in the odometry, and its covariance.
  CameraPose pose() const;
  Matrix6 covariance() const;
  /// Of the poses before and now.
  Eigen::Matrix<double, 12, 12> covarianceOfBoth() const {
    return covariance_.bottomRightCorner<12, 12>();
  }
  /// The part that is left when the map is known: what differs from frame to frame.
  Eigen::Matrix<double, 12, 12> noiseOfBoth() const;

 private:
  using Matrix23 = Eigen::Matrix<double, kSize, kSize>;

  void moveFrame();
  double update(const SmallRef& residual, const SmallRef& slope, double variance, double limit);
  void correct(const Eigen::Matrix<double, kSize, 1>& error);

  Eigen::Vector2d frame_position_ = Eigen::Vector2d::Zero();
  double frame_yaw_ = 0.0;
  Eigen::Matrix3d map_ = Eigen::Matrix3d::Identity();  // G: image of the keyframe -> ground
  CameraPose before_;
  CameraPose now_;
  Matrix23 covariance_ = Matrix23::Zero();
  Eigen::Vector2d rest_ = Eigen::Vector2d::Zero();  // of the newest homography, deviation 1
  Eigen::Matrix<double, 2, 8> rest_by_map_ = Eigen::Matrix<double, 2, 8>::Zero();
};

}  // namespace ktgp_orb::motion
