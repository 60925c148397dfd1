#pragma once

#include <Eigen/Core>
#include <opencv2/core/types.hpp>
#include <vector>

namespace ktgp_orb::mosaic {

/// Largest scale of a frame in the map, and the inverse of the smallest one.
inline constexpr double kLargestZoom = 4.0;

/// The turn of a camera that fits a homography best: K_inv H K is a rotation where it only turned.
struct TurnFit {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  double off = 0.0;  ///< root mean square over the frame of what the rotation leaves, px
};

/// `from_map`: homography to a frame of `size`; `camera`: K of both frames.
TurnFit fitTurn(const Eigen::Matrix3d& from_map, const Eigen::Matrix3d& camera,
                const cv::Size& size);

/// What a map is drawn on: the plane of its first frame, or a cylinder around a camera that turns.
///
/// Poses are homographies, first frame -> frame, for both. On the cylinder they are K R K_inv with
/// determinant 1, so the third coordinate is positive for what is in front of the camera.
class Surface {
 public:
  /// The plane; a place in the map is a pixel of the first frame.
  Surface() = default;
  /// The cylinder with the radius fx about `axis`, a unit vector in the camera of the first frame.
  /// A place is (cx + fx angle, cy + fx height), the angle is 0 where the first frame looks.
  Surface(const Eigen::Matrix3d& camera, const Eigen::Vector3d& axis);

  bool isPlane() const { return period_ == 0.0; }
  /// Length of a full turn, px; 0 for the plane.
  double period() const { return period_; }
  /// The place of a point of the first frame, homogeneous px.
  Eigen::Vector2d toMap(const Eigen::Vector3d& point) const;
  Eigen::Vector3d fromMap(const Eigen::Vector2d& place) const;
  /// The place, moved by full turns so that it is near to `other`.
  Eigen::Vector2d near(const Eigen::Vector2d& place, const Eigen::Vector2d& other) const;

  /// H(2,2) = 1 for the plane, where that is positive in front of the camera; determinant 1 for the
  /// cylinder.
  Eigen::Matrix3d scaled(const Eigen::Matrix3d& homography) const;
  /// The pose, scaled; on the cylinder the nearest one of a turn.
  Eigen::Matrix3d fitted(const Eigen::Matrix3d& from_map, const cv::Size& size) const;
  /// How far the homography is off that of a turn, px; 0 for the plane.
  double off(const Eigen::Matrix3d& from_map, const cv::Size& size) const;
  /// Where the frame shows the place of the map; not finite where a turned camera looks away.
  Eigen::Vector2d inFrame(const Eigen::Matrix3d& from_map, const Eigen::Vector2d& place) const;

  /// Whether the frame can be drawn with a scale of 1/4 to 4.
  bool canShow(const cv::Size& size, const Eigen::Matrix3d& from_map) const;
  /// The border of the frame in the map.
  std::vector<Eigen::Vector2d> outline(const cv::Size& size, const Eigen::Matrix3d& to_map) const;

 private:
  Eigen::Matrix3d camera_ = Eigen::Matrix3d::Identity();
  Eigen::Matrix3d to_axis_ = Eigen::Matrix3d::Identity();  // px -> right, along the axis, ahead
  Eigen::Matrix3d from_axis_ = Eigen::Matrix3d::Identity();
  double period_ = 0.0;
};

}  // namespace ktgp_orb::mosaic
