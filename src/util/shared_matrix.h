#pragma once

#include <opencv2/core.hpp>

namespace ktgp_orb::util {

/// Returns true if another matrix shares the memory of this matrix. If not, another thread may have
/// released the other matrix only just now. Reading the reference count with OpenCV's atomic
/// operation guarantees that this other thread has finished all its reads before this thread writes
/// to the memory.
inline bool isShared(const cv::Mat& matrix) {
  return matrix.u != nullptr && CV_XADD(&matrix.u->refcount, 0) > 1;
}

}  // namespace ktgp_orb::util
