#pragma once

#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>
#include <vector>

#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/orb_extractor.h"
#include "ktgp_orb/prosac_homography.h"

/// For programs that use OpenCV's types: its features, matches and points in, and out.
namespace ktgp_orb {

/// OrbExtractor as OpenCV's interface: detect and detectAndCompute, with masks. Colour images (BGR
/// or BGRA) become grey. Compare the descriptors with cv::NORM_HAMMING, in a cv::BFMatcher for
/// example. compute() throws cv::Exception unless there are no keypoints: a descriptor needs the
/// pyramid that its keypoint was found in. One thread at a time. Throws as OrbExtractor does.
cv::Ptr<cv::Feature2D> createFeature2D(const OrbOptions& options = {});

/// The correspondences that reached at least `level`, in order. queryIdx is the reference's
/// keypoint and trainIdx the target's, as cv::drawMatches(reference, ..., target, ...) expects;
/// the distance is d1, in bits.
std::vector<cv::DMatch> toDMatches(const std::vector<Correspondence>& correspondences,
                                   Level level = Level::ktgp);

/// ProsacHomography in one call, as easy as cv::findHomography: homography, covariance, status and
/// mask. Points are vectors of cv::Point2f or Point2d, or matrices with two columns or channels,
/// px. Put good pairs first if you know them: they are sampled first. `reference_size`: see
/// ProsacHomography::estimate. Throws std::invalid_argument for arrays of another shape or of
/// different length, and for values that are not finite. Fewer than four pairs are no error: the
/// status is too_few_matches.
ProsacResult estimateHomography(cv::InputArray reference, cv::InputArray target,
                                const ProsacOptions& options = {},
                                const cv::Size& reference_size = {});

/// The same where the noise of each pair is known: its standard deviation per coordinate, px in the
/// target, > 0. The errors, and ProsacOptions::max_error, count in units of it; pairs with less
/// noise are sampled first. See PointPairs::noise. Throws also for another number of noises, and
/// for one that is not positive.
ProsacResult estimateHomography(cv::InputArray reference, cv::InputArray target,
                                cv::InputArray noise, const ProsacOptions& options = {},
                                const cv::Size& reference_size = {});

}  // namespace ktgp_orb
