#pragma once

#include <opencv2/core/mat.hpp>
#include <string_view>

namespace ktgp_orb::files {

/// Whether a JPEG that has its end marker lacks data. OpenCV fills the missing part with grey and
/// does not pass on the warnings of libjpeg. `picture`: decoded from `bytes`. If no corner has this
/// grey, a baseline JPEG is taken as whole without reading its data, so that few pictures are
/// decoded twice. False for other formats.
bool lacksData(std::string_view bytes, const cv::Mat& picture);

}  // namespace ktgp_orb::files
