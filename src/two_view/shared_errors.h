#pragma once

#include <Eigen/Core>
#include <optional>

#include "homography/point_pairs.h"
#include "ktgp_orb/prosac_homography.h"
#include "two_view/cameras.h"

namespace ktgp_orb::two_view {

/// The errors that all points of an image share, as shifts of the points of a pair. Every geometry
/// carries them into its covariance by its derivatives with respect to the points.
class SharedShifts {
 public:
  /// Linear errors of the target points along x and along y, by 1, x and y each; the focal length
  /// of both cameras; the zoom between the images; the readout of a rolling shutter.
  static constexpr int kErrors = 9;
  template <int kRows>
  using Columns = Eigen::Matrix<double, kRows, kErrors>;

  SharedShifts() = default;
  /// Without cameras, only the linear errors are known.
  SharedShifts(const SharedErrors& deviations, const PointPairs& pairs, const TwoViewInput& input,
               const std::optional<Cameras>& cameras);

  /// The shifts if the camera turns by `rotation` from the reference to the target.
  SharedShifts with(const Eigen::Matrix3d& rotation) const;

  /// Shifts of the reference point (two rows) and of the target point (two rows) by one standard
  /// deviation of each error, px.
  Columns<4> at(const Eigen::Vector2d& reference, const Eigen::Vector2d& target) const;
  /// Shifts of the target point against the reference point as `homography` maps it.
  Columns<2> at(const Eigen::Vector2d& reference, const Eigen::Vector2d& target,
                const Eigen::Matrix3d& homography) const;

 private:
  struct Image {
    Eigen::Matrix3d camera = Eigen::Matrix3d::Identity();
    Eigen::Matrix3d inverse = Eigen::Matrix3d::Identity();
    double rows = 1.0;
    Eigen::Matrix3d turn = Eigen::Matrix3d::Zero();  // velocity of a point, as the camera turns

    Eigen::Vector2d fromCentre(const Eigen::Vector2d& point) const {
      return point - camera.topRightCorner<2, 1>();
    }
    /// Shift of a point with this velocity that is not due to the turn.
    Eigen::Vector2d read(const Eigen::Vector2d& point, const Eigen::Vector2d& velocity) const;
  };

  SharedErrors deviations_;
  homography::Normalisation linear_;
  Image reference_;
  Image target_;
  Eigen::Matrix3d turned_ = Eigen::Matrix3d::Identity();  // homography of the turn
};

}  // namespace ktgp_orb::two_view
