#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "motion/rows.h"

namespace ktgp_orb::motion {

/// Effect of a rolling shutter on homographies.
///
/// Row y is exposed later than the middle row by its share of the readout time. Until then the
/// picture has moved on by its flow, which successive homographies tell. Points of both pictures
/// moved back to the time of their middle row give the homography of a global shutter; to first
/// order it differs from the seen one by the readout time times a vector, which this finds.
///
/// The flow is filtered. It has its noise in common with the homography that it explains: without
/// the filter, a steady motion shows a shutter that is not there.
class Shutter {
 public:
  /// The next homography, from the frame at `reference_stamp` (ns) to that at `stamp`. Returns what
  /// is to be added to its entries per second of the readout time. 0 for an empty `size`, px.
  Vector8 add(const ImageMotion& motion, std::int64_t stamp, std::int64_t reference_stamp,
              const cv::Size& size, const Eigen::Matrix3d& camera);

 private:
  void follow(const Vector8& seen, const Matrix8& noise);

  std::int64_t stamp_ = 0;
  std::int64_t reference_stamp_ = 0;
  ImageMotion motion_;
  // Flow of the image: the entries of F row by row, with F(2,2) = 0. After a short time dt a point
  // x has moved to the projection of (x, 1) + dt F (x, 1).
  Vector8 flow_ = Vector8::Zero();
  Vector8 reference_flow_ = Vector8::Zero();
  // Running mean of the squares of the changes of the flow, in units of its noise; and the number
  // of changes.
  Matrix8 change_ = Matrix8::Zero();
  double changes_ = 0.0;
};

}  // namespace ktgp_orb::motion
