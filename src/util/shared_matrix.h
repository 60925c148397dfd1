#pragma once

#include <opencv2/core.hpp>

namespace ktgp_orb::util {

/// Whether another matrix shares the memory of this matrix. Another thread may just have released
/// the other matrix. So the count is read with OpenCV's atomic operation, which makes all reads of
/// that thread come before the next write here.
inline bool isShared(const cv::Mat& matrix) {
  return matrix.u != nullptr && CV_XADD(&matrix.u->refcount, 0) > 1;
}

}  // namespace ktgp_orb::util
