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

/// A rotation that pictures show: camera now -> camera then. The covariance is that of small
/// rotations about the axes of the camera now, rad².
struct SeenTurn {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  /// Derivative of the small rotations now by those of the camera then: effect of a wrong normal.
  Eigen::Matrix3d by_tilt = Eigen::Matrix3d::Zero();
};

/// The map of a keyframe, and the poses of the two newest frames, with their joint covariance: an
/// extended Kalman filter whose new pose is a weighted least-squares fit to the homography.
///
/// All poses are in a frame of the keyframe: its origin is below the keyframe, and x, y and yaw of
/// the keyframe are exact there. The place of that frame in the odometry gets less and less
/// certain; it is a state of its own. With one frame for all, the derivatives of different times
/// would disagree, which would turn the large uncertainty of x, y and yaw into wrong corrections.
class GroundFilter {
 public:
  /// First index of each part of the error state: x, y and yaw of the keyframe's frame (3 entries),
  /// the readout time (1), E of the map (8), the pose of the previous frame (6) and of the newest
  /// frame (6). kSize is the number of entries.
  static constexpr int kFrame = 0, kReadout = 3, kMap = 4, kBefore = 12, kNow = 18, kSize = 24;

  /// Readout time of the shutter, s; 0: a global shutter, -1: not known.
  void setReadout(double seconds);
  /// An image has been read when the next one begins: the readout time is at most `seconds`, the
  /// time between two images. Before the first homography of the later one.
  void allowReadout(double seconds);
  /// The same after it, for the estimate.
  void limitReadout(double seconds);
  double readout() const { return readout_; }
  double readoutDeviation() const { return std::sqrt(covariance_(kReadout, kReadout)); }

  /// A pose in the odometry, without a map.
  void start(const CameraPose& pose, const Matrix6& covariance);
  /// Moves the pose on with a twist of the camera in its frame. Then there is no map.
  void predict(const Vector6& twist, const Matrix6& twist_covariance, double seconds,
               const GroundMotionOptions& options);
  /// Moves x, y and the yaw of the base to those of `base`, and to the covariance there; height and
  /// tilt keep theirs. Then there is no map.
  void moveBase(const Pose3& base, const Covariance6& covariance_of_base,
                const Pose3& base_to_camera);
  /// Makes the reference of `motion` the keyframe. Its pose, if `at_reference`, or else that of the
  /// frame that `motion` leads to, is the pose now. `motion`: with all its covariance, of which a
  /// share belongs to the keyframe.
  void setKeyframe(const ImageMotion& motion, bool at_reference);
  /// The pose now becomes the one before, and `motion` leads from the keyframe to a new one. The
  /// homography has eight numbers and a pose six: the two constraints that are left correct the map
  /// and the readout time. Returns by how many standard deviations they differ from what was
  /// expected; the noise of such a homography is enlarged as much. Empty, without any change: no
  /// pose fits.
  std::optional<Innovation> advance(const ImageMotion& motion);

  /// The rotation since the keyframe by this homography alone: no reading of a turn is in it, only
  /// the plane that is known. Empty: none fits.
  std::optional<SeenTurn> turnSinceKeyframe(const ImageMotion& motion) const;

  /// Corrects everything by a reading of the newest pose, with the noise that readings of its kind
  /// have shown, on ground of that number. A reading that differs from the expectation by more than
  /// noise gets less weight: see update(). Returns its misfit.
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
  /// Allows for other ground: adds variances of its height, as a share of the height, and of its
  /// tilt. Poses and map follow it together.
  void widen(double scale_variance, double tilt_variance);

  /// In the frame of the keyframe.
  const CameraPose& now() const { return now_; }
  const CameraPose& before() const { return before_; }
  /// False after numbers that were too large to compute with; the filter must then restart.
  bool isFinite() const { return now_.position.allFinite() && covariance_.allFinite(); }
  /// The newest pose in the odometry, and its covariance.
  CameraPose pose() const;
  Matrix6 covariance() const;
  /// Writes the height and the pose of the base to `estimate`. `origin`: the error of all lengths
  /// (scale_deviation) counts from there.
  void report(const Eigen::Vector3d& origin, const GroundMotionOptions& options,
              GroundEstimate& estimate) const;
  /// Standard deviation of the newest pose's tilt about one axis, rad.
  double tiltDeviation() const;
  /// Joint covariance of the poses before and now.
  Eigen::Matrix<double, 12, 12> covarianceOfBoth() const {
    return covariance_.bottomRightCorner<12, 12>();
  }
  /// The part of it that is left when the map is known: the errors that differ from frame to frame.
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
  Eigen::Matrix3d map_ = Eigen::Matrix3d::Identity();  // G: image of the keyframe -> ground
  CameraPose before_;
  CameraPose now_;
  double readout_ = 0.0;   // s
  double allowed_ = 0.0;   // the longest readout time that the covariance allows for, s
  bool is_known_ = false;  // the readout time was given
  StateCovariance covariance_ = StateCovariance::Zero();
  // The two constraints of the newest homography, with unit noise, and their derivatives by the
  // readout time and the map.
  Eigen::Vector2d constraints_ = Eigen::Vector2d::Zero();
  Eigen::Matrix<double, 2, kSize> constraints_by_state_ = Eigen::Matrix<double, 2, kSize>::Zero();
};

}  // namespace ktgp_orb::motion
