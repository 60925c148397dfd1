#pragma once

#include <opencv2/core/mat.hpp>
#include <string_view>

namespace ktgp_orb::files {

/// Whether data of a JPEG are missing although it has its end: `picture`, decoded from `bytes`, has
/// grey in place of what is missing, and libraries do not say so. The data are counted only if the
/// picture has this grey in a corner. False for progressive JPEGs, where the data come in several
/// scans, and for what is no JPEG.
bool lacksData(std::string_view bytes, const cv::Mat& picture);

}  // namespace ktgp_orb::files
