#pragma once

#include <opencv2/core.hpp>

namespace ktgp_orb::util {

/// Whether another matrix shares the memory of this matrix. Another thread may just have released
/// the other matrix. So the reference count is read with OpenCV's atomic operation. It guarantees
/// that all reads of the other thread come before the next write of this thread.
inline bool isShared(const cv::Mat& matrix) {
  return matrix.u != nullptr && CV_XADD(&matrix.u->refcount, 0) > 1;
}

}  // namespace ktgp_orb::util
