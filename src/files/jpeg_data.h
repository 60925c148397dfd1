#pragma once

#include <opencv2/core/mat.hpp>
#include <string_view>

namespace ktgp_orb::files {

/// For a JPEG file that has its end marker: returns true if image data are missing nevertheless.
/// OpenCV fills the missing part with grey and does not pass on libjpeg's warnings. `picture`: the
/// image decoded from `bytes`. If no corner of `picture` has this grey, a baseline JPEG is assumed
/// to be complete, so that few images need to be decoded twice. Returns false for other formats.
bool lacksData(std::string_view bytes, const cv::Mat& picture);

}  // namespace ktgp_orb::files
