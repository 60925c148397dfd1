#pragma once

#include <Eigen/Core>
#include <opencv2/core/types.hpp>
#include <vector>

namespace ktgp_orb::mosaic {

/// Largest allowed scale of a frame in the map. The smallest allowed scale is its inverse.
inline constexpr double kLargestZoom = 4.0;

/// The rotation R of a camera that explains a homography H best. If the camera only turned, H = K R
/// K_inv, where K is the camera matrix.
struct TurnFit {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  /// Deviation of H from K R K_inv, px (rms over the frame).
  double off = 0.0;
};

/// `from_map`: homography from the first frame to a frame of `size`, px. `camera`: the camera
/// matrix K of both frames, px.
TurnFit fitTurn(const Eigen::Matrix3d& from_map, const Eigen::Matrix3d& camera,
                const cv::Size& size);

/// The surface on which a map is drawn: the plane of the first frame, or a cylinder around a camera
/// that turns.
///
/// For both surfaces, a pose is a homography H, first frame -> frame. On the cylinder, H = K R
/// K_inv with determinant 1 (K: camera matrix; R: rotation since the first frame). So if x is a
/// point of the first frame in homogeneous px, the third coordinate of H x is positive if the point
/// is in front of the camera.
class Surface {
 public:
  /// The plane of the first frame; a place in the map is a pixel of the first frame.
  Surface() = default;
  /// A cylinder about `axis`, a unit vector in the coordinates of the first camera. Its radius is
  /// the focal length fx of `camera`. A place in the map is (cx + fx angle, cy + fx height), where
  /// (cx, cy) is the principal point of `camera`. The angle about the axis is 0 in the viewing
  /// direction of the first frame; the height along the axis is in radii.
  Surface(const Eigen::Matrix3d& camera, const Eigen::Vector3d& axis);

  bool isPlane() const { return period_ == 0.0; }
  /// Circumference of the cylinder, px of the map; 0 for the plane.
  double period() const { return period_; }
  /// Maps a point of the first frame, in homogeneous px, to its place in the map.
  Eigen::Vector2d toMap(const Eigen::Vector3d& point) const;
  Eigen::Vector3d fromMap(const Eigen::Vector2d& place) const;
  /// Returns `place`, shifted by the number of full turns that brings it nearest to `other`. On the
  /// plane, returns `place`.
  Eigen::Vector2d near(const Eigen::Vector2d& place, const Eigen::Vector2d& other) const;

  /// Scales the homography: H(2,2) = 1 for the plane, determinant 1 for the cylinder.
  Eigen::Matrix3d scaled(const Eigen::Matrix3d& homography) const;
  /// Returns the pose `from_map`, scaled as scaled() does. On the cylinder, first replaces it by
  /// the nearest pose of a camera that only turned.
  Eigen::Matrix3d fitted(const Eigen::Matrix3d& from_map, const cv::Size& size) const;
  /// Deviation of the pose from the nearest pose of a camera that only turned, px (rms); 0 for the
  /// plane.
  double off(const Eigen::Matrix3d& from_map, const cv::Size& size) const;
  /// Returns the pixel of the frame that shows `place`. Its coordinates are infinite if the surface
  /// is a cylinder and `place` is behind the camera.
  Eigen::Vector2d inFrame(const Eigen::Matrix3d& from_map, const Eigen::Vector2d& place) const;

  /// Returns true if the frame can be drawn at a scale of 1/kLargestZoom to kLargestZoom.
  bool canShow(const cv::Size& size, const Eigen::Matrix3d& from_map) const;
  /// Returns the border of the frame in the map, as a polygon.
  std::vector<Eigen::Vector2d> outline(const cv::Size& size, const Eigen::Matrix3d& to_map) const;

 private:
  Eigen::Matrix3d camera_ = Eigen::Matrix3d::Identity();
  // Maps homogeneous px of the first frame to the coordinates of the cylinder: x points to the
  // right, y along the cylinder's axis, and z ahead.
  Eigen::Matrix3d to_axis_ = Eigen::Matrix3d::Identity();
  Eigen::Matrix3d from_axis_ = Eigen::Matrix3d::Identity();
  double period_ = 0.0;
};

}  // namespace ktgp_orb::mosaic
