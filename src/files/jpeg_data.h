#pragma once

#include <opencv2/core/mat.hpp>
#include <string_view>

namespace ktgp_orb::files {

/// Returns true if a JPEG file has its end marker, but image data are missing. OpenCV fills the
/// missing part with grey and does not pass on libjpeg's warnings. `picture`: the image decoded
/// from `bytes`. To decode few images twice, we assume that a baseline JPEG is complete if no
/// corner of `picture` has this grey. Returns false for other formats.
bool lacksData(std::string_view bytes, const cv::Mat& picture);

}  // namespace ktgp_orb::files
