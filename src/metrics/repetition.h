#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace ktgp_orb::metrics {

/// Where the middle of `picture`, half its width and height, looks like a part of `other`: shifts
/// in px that are local maxima of a normalised correlation of at least `least`, the best first.
/// Only {0, 0} for a middle of one grey level. Both CV_8UC1; `other` may be `picture`.
std::vector<cv::Point> alikeShifts(const cv::Mat& picture, const cv::Mat& other, double least);

/// Periods longer than this share of the sides are not seen: too little is left to compare.
constexpr double kLongestPeriod = 0.6;

/// Whether a CV_8UC1 picture looks like itself moved by `shift`, px; also where that is too far to
/// compare.
bool repeatsAfter(const cv::Mat& picture, const cv::Point2d& shift);

/// The shortest shift, px, by which a CV_8UC1 picture looks like itself; 0 if there is none of 2 %
/// of its longer side up to kLongestPeriod.
double shortestPeriod(const cv::Mat& picture);

}  // namespace ktgp_orb::metrics
