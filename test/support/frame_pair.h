#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "ktgp_orb/ktgp_matcher.h"
#include "ktgp_orb/orb_extractor.h"
#include "synthetic_pairs.h"

namespace ktgp_orb::test {

Features featuresOf(const cv::Mat& image, const OrbOptions& options = {});

struct FramePair {
  FramePair() = default;
  FramePair(const cv::Mat& reference_image, const cv::Mat& target_image,
            const OrbOptions& options = {});

  Features reference, target;
};

MatchResult matched(const FramePair& pair, const MatcherOptions& options = {},
                    const MatchHints& hints = {});

/// The image after a homography.
cv::Mat warped(const cv::Mat& image, const Eigen::Matrix3d& homography, const cv::Size& size,
               int interpolation = cv::INTER_CUBIC);

/// A keypoint with its descriptor; the angle in radians.
void addKeypoint(const Eigen::Vector2d& at, double angle, double size,
                 const std::vector<std::uint8_t>& descriptor, Features& features);

/// Frames of `count` keypoints in 640x480 px. The first `inliers` of them follow `truth`, with
/// descriptors that differ in at most `flips` bits. The next `lures` have equal descriptors at
/// random positions. The others are unrelated.
FramePair drawnPair(int count, int inliers, const Eigen::Matrix3d& truth, std::uint64_t seed,
                    int lures = 0, int flips = 25);

}  // namespace ktgp_orb::test
