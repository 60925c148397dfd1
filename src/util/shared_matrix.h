#pragma once

#include <opencv2/core.hpp>

namespace ktgp_orb::util {

/// Whether another matrix shares the memory of this matrix. Another thread may have released the
/// other matrix just now. So the reference count is read with OpenCV's atomic operation, which
/// guarantees that all reads of the other thread come before the next write of this thread.
inline bool isShared(const cv::Mat& matrix) {
  return matrix.u != nullptr && CV_XADD(&matrix.u->refcount, 0) > 1;
}

}  // namespace ktgp_orb::util
