#pragma once

#include <ktgp_orb/Correspondences.h>
#include <ktgp_orb/HomographyStamped.h>
#include <ktgp_orb/MatchStatistics.h>
#include <sensor_msgs/Image.h>

#include <Eigen/Core>

#include "ktgp_orb/ktgp_matcher.h"
#include "nodelet/frame.h"

namespace ktgp_orb {

/// Every correspondence that passed the ratio filter, with the level it reached.
CorrespondencesPtr toCorrespondences(const Frame& reference, const Frame& target,
                                     const MatchResult& result);

/// The homography with its verdict; numbers are zero unless the status is ok.
HomographyStampedPtr toHomography(const Frame& reference, const Frame& target,
                                  const MatchResult& result);

/// Statistics of `target`; `reference` and `result` are null where there was no reference. What
/// only the caller knows (latency, counters, configuration) is left at zero.
MatchStatisticsPtr toStatistics(const Frame* reference, const Frame& target,
                                const MatchResult* result);

/// The overlay picture (bgr8) with the header of the target.
sensor_msgs::ImagePtr toOverlay(const Frame& reference, const Frame& target,
                                const MatchResult& result);

/// Row-major, as in the messages.
void copyHomography(const Eigen::Matrix3d& homography, HomographyStamped& message);

}  // namespace ktgp_orb
