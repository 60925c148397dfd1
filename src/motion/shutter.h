#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "motion/rows.h"

namespace ktgp_orb::motion {

/// What a rolling shutter does to homographies.
///
/// Row y is exposed later than the middle row by its share of the readout time. Until then the
/// picture has moved on by its flow, which successive homographies tell. Points of both pictures
/// moved back to the time of their middle row give the homography of a global shutter; to first
/// order it differs from the seen one by the readout time times a vector, which this finds.
class Shutter {
 public:
  /// The next homography, from the frame at `reference_stamp` (ns) to that at `stamp`, between
  /// images of focal length 1. Returns what is to be added to its entries per second of the readout
  /// time. 0 for an empty `size`, px.
  Vector8 add(const Eigen::Matrix3d& homography, std::int64_t stamp, std::int64_t reference_stamp,
              const cv::Size& size, const Eigen::Matrix3d& camera);

 private:
  std::int64_t stamp_ = 0;
  std::int64_t reference_stamp_ = 0;
  Eigen::Matrix3d homography_ = Eigen::Matrix3d::Identity();
  // Of the points x of a picture: dx/dt is that of the projection of (x, 1) + dt flow (x, 1).
  Eigen::Matrix3d flow_ = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d reference_flow_ = Eigen::Matrix3d::Zero();
};

}  // namespace ktgp_orb::motion
