#pragma once

#include <opencv2/core.hpp>

namespace ktgp_orb::util {

/// Whether another matrix shares this one's memory. A holder in another thread may just have let
/// go: read with OpenCV's own atomic operation, all that it read comes before what is written next.
inline bool isShared(const cv::Mat& matrix) {
  return matrix.u != nullptr && CV_XADD(&matrix.u->refcount, 0) > 1;
}

}  // namespace ktgp_orb::util
