#pragma once

#include <opencv2/core/mat.hpp>
#include <string_view>

namespace ktgp_orb::files {

/// Whether a JPEG that has its end marker lacks data. Decoders fill the missing part with grey and
/// do not report it. `picture`: decoded from `bytes`. If no corner has this grey, returns false
/// without checking the data. False for progressive JPEGs, whose data come in several scans, and
/// for other formats.
bool lacksData(std::string_view bytes, const cv::Mat& picture);

}  // namespace ktgp_orb::files
