#include <Eigen/Geometry>

#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb {

double reprojectionError(const Eigen::Matrix3d& homography, const Eigen::Vector2d& reference,
                         const Eigen::Vector2d& target) {
  const Eigen::Vector3d p = homography * reference.homogeneous();
  return (p.hnormalized() - target).norm();
}

}  // namespace ktgp_orb
