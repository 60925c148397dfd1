#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace ktgp_orb::metrics {

/// Returns the shifts, px, that move the middle of `picture` (half its width and height) to a place
/// where `other` looks alike. These are the local maxima of the normalised correlation that are at
/// least `least`, best first. Returns only {0, 0} if the middle has a single grey level. Both
/// pictures are CV_8UC1; `other` may be `picture`.
std::vector<cv::Point> alikeShifts(const cv::Mat& picture, const cv::Mat& other, double least);

/// Longest period that can be found, as a share of the width or height of the picture. With a
/// longer period, the picture and its shifted copy overlap too little to be compared.
constexpr double kLongestPeriod = 0.6;

/// Returns true if a CV_8UC1 picture looks like its own copy that is moved by `shift`, px. Also
/// returns true if the shift is too long to be tested (see kLongestPeriod).
bool repeatsAfter(const cv::Mat& picture, const cv::Point2d& shift);

/// Returns a copy of the picture whose longer side is at most 192 px. The functions below compare
/// such copies.
cv::Mat shrunk(const cv::Mat& picture);

/// Normalised correlation, -1..1, of two shrunk CV_8UC1 pictures of one size where `mask` (CV_8UC1)
/// is not 0. Slow changes of brightness do not count. Returns 0 if less than 2 % can be compared,
/// or if there is no contrast.
double alikeness(const cv::Mat& one, const cv::Mat& other, const cv::Mat& mask);

/// Highest normalised correlation, 0..1, of a shrunk CV_8UC1 picture and its own copy, moved by 2 %
/// of its longer side up to kLongestPeriod. Slow changes of brightness do not count.
double alikenessToItself(const cv::Mat& picture);

/// Returns the shortest shift, px, after which a CV_8UC1 picture looks like itself, or 0 if there
/// is none. Shifts from 2 % of its longer side up to kLongestPeriod are tested.
double shortestPeriod(const cv::Mat& picture);

}  // namespace ktgp_orb::metrics
