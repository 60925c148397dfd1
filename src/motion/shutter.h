#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "motion/rows.h"

namespace ktgp_orb::motion {

/// Finds the effect of a rolling shutter on a homography.
///
/// A row below the middle row is exposed later than the middle row, the last row by half of the
/// readout time. Meanwhile the image moves; this motion (the flow) is computed from successive
/// homographies. If the points of both images are moved to where they were when the middle row was
/// exposed, they give the homography of a global shutter. To first order, its entries are the
/// measured entries plus the readout time times a vector. This class computes the vector.
///
/// The flow is filtered, because its noise comes from the same homography that is to be corrected.
/// Without the filter, this noise would look like a rolling shutter during a steady motion.
class Shutter {
 public:
  /// Adds the homography from the frame at `reference_stamp` (ns) to the frame at `stamp` (ns).
  /// Returns the correction of its entries per second of the readout time; 0 if `size` (px) is
  /// empty.
  Vector8 add(const ImageMotion& motion, std::int64_t stamp, std::int64_t reference_stamp,
              const cv::Size& size, const Eigen::Matrix3d& camera);

 private:
  Vector8 correction(const cv::Size& size, const Eigen::Matrix3d& camera) const;
  void follow(const Vector8& seen, const Matrix8& noise);

  bool has_frame_ = false;
  std::int64_t stamp_ = 0;  // of the newest frame
  std::int64_t reference_stamp_ = 0;
  ImageMotion motion_;
  // Flow of the image: the entries of a matrix F row by row, with F(2,2) = 0. In a short time dt, a
  // point x moves to the projection of (x, 1) + dt F (x, 1).
  Vector8 flow_ = Vector8::Zero();
  Vector8 reference_flow_ = Vector8::Zero();
  // change_: running mean of the outer product c c', where c is a change of the flow in units of
  // its noise (whitened). changes_: number of changes in the mean.
  Matrix8 change_ = Matrix8::Zero();
  double changes_ = 0.0;
};

}  // namespace ktgp_orb::motion
