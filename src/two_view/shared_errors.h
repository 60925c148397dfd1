#pragma once

#include <Eigen/Core>
#include <optional>

#include "homography/point_pairs.h"
#include "ktgp_orb/prosac_homography.h"
#include "two_view/cameras.h"

namespace ktgp_orb::two_view {

/// Converts the errors that all points of an image share (see SharedErrors) to shifts of the two
/// points of a pair. Each geometry propagates these shifts to its covariance, with its derivatives
/// with respect to the points.
class SharedShifts {
 public:
  /// Number of shared errors. Columns 0 to 2: shift of the target points along x, proportional to
  /// x, proportional to y, and constant, where x and y are the normalised position in the target; 3
  /// to 5: the same along y; 6: focal length of both cameras; 7: zoom between the images; 8 and 9:
  /// principal point of both cameras along x and y; 10: distortion of both images; 11: readout of a
  /// rolling shutter.
  static constexpr int kErrors = 12;
  template <int kRows>
  using Columns = Eigen::Matrix<double, kRows, kErrors>;

  SharedShifts() = default;
  /// Without `cameras`, only the linear errors are taken into account.
  SharedShifts(const SharedErrors& deviations, const PointPairs& pairs, const TwoViewInput& input,
               const std::optional<Cameras>& cameras);

  /// Returns a copy for a camera that turns by `rotation` from the reference to the target. The
  /// shifts by the readout depend on this rotation.
  SharedShifts with(const Eigen::Matrix3d& rotation) const;

  /// How far one standard deviation of each error (one column each) shifts the reference point
  /// (first two rows) and the target point (last two rows), px.
  Columns<4> at(const Eigen::Vector2d& reference, const Eigen::Vector2d& target) const;
  /// How far one standard deviation of each error shifts the target point relative to the reference
  /// point mapped by `homography`, px.
  Columns<2> at(const Eigen::Vector2d& reference, const Eigen::Vector2d& target,
                const Eigen::Matrix3d& homography) const;

 private:
  /// Camera matrix K of an image (px), its inverse, the height of the image and half of its
  /// diagonal, px.
  struct Image {
    Eigen::Matrix3d camera = Eigen::Matrix3d::Identity();
    Eigen::Matrix3d inverse = Eigen::Matrix3d::Identity();
    double rows = 1.0;
    double corner = 1.0;
    // K [w] K^-1, where [w] is the cross product matrix of the camera's rotation during the
    // readout, rad: maps a homogeneous point to its change during the readout.
    Eigen::Matrix3d turn = Eigen::Matrix3d::Zero();

    Eigen::Vector2d fromCentre(const Eigen::Vector2d& point) const {
      return point - camera.topRightCorner<2, 1>();
    }
    /// Returns the shift of `point` by a radial distortion of 1 px at the corners.
    Eigen::Vector2d distorted(const Eigen::Vector2d& point) const {
      const Eigen::Vector2d off = fromCentre(point) / corner;
      return off.squaredNorm() * off;
    }
    /// Returns how far `point` is shifted, px, because its row is read earlier or later than the
    /// row of the principal point. `velocity`: how far the point moves during the readout, px,
    /// apart from its movement due to the camera's rotation.
    Eigen::Vector2d read(const Eigen::Vector2d& point, const Eigen::Vector2d& velocity) const;
  };

  SharedErrors deviations_;
  homography::Normalisation linear_;  // normalises the target points
  Image reference_;
  Image target_;
  // Homography of the rotation given to with(); it maps reference points to the target.
  Eigen::Matrix3d turned_ = Eigen::Matrix3d::Identity();
};

}  // namespace ktgp_orb::two_view
