#pragma once

#include <opencv2/core.hpp>

namespace ktgp_orb::util {

/// Whether another matrix shares this one's memory. Another thread may just have released it. The
/// count is read with OpenCV's atomic operation, so that all reads of that thread come before the
/// next write here.
inline bool isShared(const cv::Mat& matrix) {
  return matrix.u != nullptr && CV_XADD(&matrix.u->refcount, 0) > 1;
}

}  // namespace ktgp_orb::util
