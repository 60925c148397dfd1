#pragma once

#include <opencv2/core/mat.hpp>
#include <string_view>

namespace ktgp_orb::files {

/// Returns true if a JPEG file has its end marker, but image data are missing. OpenCV fills the
/// missing part with grey and does not pass on libjpeg's warnings. `picture`: the image decoded
/// from `bytes`. If no corner of `picture` has this grey, we assume that a baseline JPEG is
/// complete, because decoding every image a second time would take long. Returns false for other
/// formats.
bool lacksData(std::string_view bytes, const cv::Mat& picture);

}  // namespace ktgp_orb::files
