#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace ktgp_orb::metrics {

/// Shifts, px, by which the middle of `picture` (half the width and height) looks like a part of
/// `other`. The shifts are the local maxima of the normalised correlation with a value of at least
/// `least`, sorted with the best first. Returns only {0, 0} if the middle has a single grey level.
/// Both pictures are CV_8UC1; `other` may be `picture`.
std::vector<cv::Point> alikeShifts(const cv::Mat& picture, const cv::Mat& other, double least);

/// Longest period that can be found, as a share of the sides. With a longer period the overlap is
/// too small.
constexpr double kLongestPeriod = 0.6;

/// Whether a CV_8UC1 picture looks like itself moved by `shift`, px. Also returns true if the shift
/// is too long to decide.
bool repeatsAfter(const cv::Mat& picture, const cv::Point2d& shift);

/// The shortest shift, px, by which a CV_8UC1 picture looks like itself. Shifts from 2 % of its
/// longer side up to kLongestPeriod are tried. Returns 0 if there is none.
double shortestPeriod(const cv::Mat& picture);

}  // namespace ktgp_orb::metrics
