#pragma once

#include <opencv2/core.hpp>

#include "core/orb/kernels.h"

namespace ktgp_orb::orb {

/// Descriptors do not read the blurred image closer to the border than this, px.
constexpr int kBlurMargin = kEdgeMargin - kPatternRadius;

/// Memory of one thread for blurRows.
using BlurScratch = cv::Mat;

/// Blurs the rows [first_row, last_row) of `image` with a 7x7 Gaussian of sigma 2 into `blurred`,
/// except for kBlurMargin pixels on each side. The rows keep this distance from the border, too;
/// `blurred` is as large as `image` and 64 bytes wider.
///
/// The arithmetic is that of cv::ORB on a processor with fused multiply-add: single precision, one
/// rounding per term. (On one without, OpenCV 4.6 rounds twice per term, which changes about three
/// pixels in a million by one grey value; this function does not.)
void blurRows(const cv::Mat& image, int first_row, int last_row, const OrbKernels& kernels,
              BlurScratch& scratch, cv::Mat& blurred);

}  // namespace ktgp_orb::orb
