#pragma once

#include <Eigen/Core>
#include <cmath>
#include <optional>

#include "motion/noise.h"
#include "motion/rows.h"
#include "util/small_matrix.h"

namespace ktgp_orb::motion {

using util::SmallMatrix;
using util::SmallRef;

/// The rotation, computed from the images, from the camera's frame at the newest image to its frame
/// at the keyframe. The covariance (rad²) is for small rotations about the camera's axes at the
/// newest image.
struct SeenTurn {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  /// How `rotation` changes if the normal of the ground is wrong, so that the pose of the keyframe
  /// is tilted: the Jacobian of small rotations at the newest image (as for `covariance`) with
  /// respect to small rotations of the camera at the keyframe.
  Eigen::Matrix3d by_tilt = Eigen::Matrix3d::Zero();
};

/// Extended Kalman filter that estimates the map of a keyframe (see GroundMotion) and the poses of
/// the two newest frames, with their joint covariance. Each new pose is a weighted least-squares
/// fit to the homography.
///
/// All poses are in the filter's own coordinate frame. setKeyframe() moves its origin to the ground
/// below the newest pose, whose x, y and yaw are then exact. The position and yaw of this frame in
/// the odometry frame become less and less certain, so they are states of their own. If all poses
/// were in the odometry frame, Jacobians computed at different times would disagree, and because of
/// the large uncertainty of x, y and yaw the filter would make wrong corrections.
class GroundFilter {
 public:
  /// First index of each part of the error state: x, y and yaw of the filter's frame (3 entries),
  /// the readout time (1), the error E of the map (8, see byMap()), the pose of the previous image
  /// (6) and the pose of the newest image (6). kSize is the number of entries.
  static constexpr int kFrame = 0, kReadout = 3, kMap = 4, kBefore = 12, kNow = 18, kSize = 24;

  /// Sets the readout time of the shutter, s; 0 for a global shutter, -1 if it is not known.
  void setReadout(double seconds);
  /// If the readout time is unknown, lets the filter consider values up to +- `seconds`, the time
  /// between two images (at most 1/30 s; the longest one so far counts), because an image is read
  /// out completely before the next one begins. Call this before adding the second image.
  void allowReadout(double seconds);
  /// Keeps the estimate of an unknown readout time within the bound of allowReadout(). A shorter
  /// time between two stamps does not limit it, because a single stamp may be wrong.
  void limitReadout();
  double readout() const { return readout_; }
  double readoutDeviation() const { return std::sqrt(covariance_(kReadout, kReadout)); }

  /// Starts with a pose in the odometry frame. There is no map at first.
  void start(const CameraPose& pose, const Matrix6& covariance);
  /// Predicts the pose `seconds` after the newest pose from the camera's twist, which is given in
  /// the camera's own frame. Drops the map.
  void predict(const Vector6& twist, const Matrix6& twist_covariance, double seconds,
               const GroundMotionOptions& options);
  /// Moves the vehicle's base to x, y and yaw of `base`, and sets the covariance of these three.
  /// The height and the tilt do not change. Drops the map.
  void moveBase(const Pose3& base, const Covariance6& covariance_of_base,
                const Pose3& base_to_camera);
  /// Makes the reference frame of `motion` the keyframe. If `at_reference` is true, the newest pose
  /// is the pose of this reference, otherwise the pose of the target frame of `motion`. Pass the
  /// full covariance of the homography; this function scales it to the part caused by the
  /// keyframe's image (kOfKeyframe).
  void setKeyframe(const ImageMotion& motion, bool at_reference);
  /// Adds a frame. `motion`: homography from the keyframe to this frame. Six of its eight degrees
  /// of freedom determine the pose. The two remaining constraints correct the map and the readout
  /// time. Returns the innovation of these constraints. If the innovation is large, the variance of
  /// the homography is enlarged. If no pose fits, nothing changes and the result is empty.
  std::optional<Innovation> advance(const ImageMotion& motion);

  /// The rotation since the keyframe, computed from `motion` and the ground plane of the map;
  /// TurnReadings are not used. Empty if no pose fits.
  std::optional<SeenTurn> turnSinceKeyframe(const ImageMotion& motion) const;

  /// Corrects the state with a linearised reading, `rows`. `of_kind`: estimates the noise of this
  /// kind of reading from the innovations; the innovation of this reading is added to it. `ground`:
  /// identifies the ground below the camera, see Innovations::add. A reading that contradicts the
  /// prediction gets less weight, see update(). Returns the misfit of the reading in standard
  /// deviations.
  template <int kRows>
  double use(const PoseRows<kRows>& rows, Innovations& of_kind, std::int64_t ground) {
    Eigen::Matrix<double, kRows, kSize> slope = Eigen::Matrix<double, kRows, kSize>::Zero();
    slope.template middleCols<6>(kBefore) = rows.slope_before;
    slope.template rightCols<6>() = rows.slope;
    const Innovation innovation =
        innovationOf(rows.residual, slope, rows.deviation * rows.deviation);
    of_kind.add(innovation, ground);
    const double deviation = rows.deviation * std::sqrt(of_kind.factor());
    update(rows.residual, slope, deviation * deviation);
    return innovation.misfit;
  }
  /// Makes the ground less certain: adds a variance to its height (relative to the height) and to
  /// its tilt (rad²). Because an error of the ground shifts both poses and the map along with it,
  /// their variances grow, too.
  void widen(double scale_variance, double tilt_variance);

  /// The newest and the previous pose, in the filter's own frame.
  const CameraPose& now() const { return now_; }
  const CameraPose& before() const { return before_; }
  /// False after a numeric overflow. The filter must then be restarted.
  bool isFinite() const { return now_.position.allFinite() && covariance_.allFinite(); }
  /// The newest pose in the odometry frame, and its covariance.
  CameraPose pose() const;
  Matrix6 covariance() const;
  /// Writes the height and the pose of the base to `estimate`. `origin`: the position of the camera
  /// at which an error of the scale (scale_deviation) has no effect; the effect grows with the
  /// distance from this point.
  void report(const Eigen::Vector3d& origin, const GroundMotionOptions& options,
              GroundEstimate& estimate) const;
  /// Standard deviation of the newest pose's tilt, rad: the larger of the values for the two
  /// horizontal axes.
  double tiltDeviation() const;
  /// Joint covariance of the previous and the newest pose.
  Eigen::Matrix<double, 12, 12> covarianceOfBoth() const {
    return covariance_.bottomRightCorner<12, 12>();
  }
  /// The part of covarianceOfBoth() that is not caused by errors of the map: the noise that is
  /// independent from frame to frame.
  Eigen::Matrix<double, 12, 12> noiseOfBoth() const;

 private:
  using State = Eigen::Matrix<double, kSize, 1>;
  using StateCovariance = Eigen::Matrix<double, kSize, kSize>;

  void moveFrame();
  void replace(int begin, const SmallRef& slope, const SmallRef& noise);
  Eigen::Matrix3d straightened(const ImageMotion& motion) const;
  bool fit(const ImageMotion& motion, double noise);
  Innovation innovationOf(const SmallRef& residual, const SmallRef& slope, double variance) const;
  void update(const SmallRef& residual, const SmallRef& slope, double variance);
  State groundStep(const Eigen::Vector3d& turn, double scale, const CameraPose& keyframe) const;
  void correct(const State& error);

  Eigen::Vector2d frame_position_ = Eigen::Vector2d::Zero();
  double frame_yaw_ = 0.0;
  // The homography G of GroundMotion: maps the image of the keyframe to the ground.
  Eigen::Matrix3d map_ = Eigen::Matrix3d::Identity();
  CameraPose before_;
  CameraPose now_;
  double readout_ = 0.0;   // s
  double allowed_ = 0.0;   // the longest readout time that the covariance allows for, s
  bool is_known_ = false;  // true if the readout time was given
  StateCovariance covariance_ = StateCovariance::Zero();
  // The two constraints that the newest homography adds, scaled to unit noise, and their
  // derivatives with respect to the readout time and the map.
  Eigen::Vector2d constraints_ = Eigen::Vector2d::Zero();
  Eigen::Matrix<double, 2, kSize> constraints_by_state_ = Eigen::Matrix<double, 2, kSize>::Zero();
};

}  // namespace ktgp_orb::motion
