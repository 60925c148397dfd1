#pragma once

#include <ktgp_orb/Correspondences.h>
#include <ktgp_orb/HomographyStamped.h>
#include <ktgp_orb/Match.h>
#include <ktgp_orb/MatchStatistics.h>
#include <sensor_msgs/Image.h>
#include <std_msgs/Header.h>

#include <string>

#include "ktgp_orb/overlay.h"
#include "ktgp_orb/sequence_matcher.h"

namespace ktgp_orb {

/// The messages of one frame. Some are null for a frame without a reference.
struct FrameMessages {
  CorrespondencesPtr correspondences;  ///< may be null
  HomographyStampedPtr homography;
  HomographyStampedPtr accumulated_homography;  ///< null unless the chain of frames is unbroken
  MatchStatisticsPtr statistics;
  sensor_msgs::ImagePtr overlay;  ///< null unless wanted
};

/// All except the overlay; `header`: of the target image. Statistics that only the caller knows
/// (latency, counters, configuration) are zero.
FrameMessages toMessages(const std_msgs::Header& header, const SequenceMatch& match);

/// All messages except the picture in one; call it when the statistics are complete.
MatchPtr toMatch(const FrameMessages& messages);

/// A sentence for users.
std::string explanation(NoReference reason);

/// The overlay picture (bgr8) with the header of the target; without a reference it shows the
/// reason.
sensor_msgs::ImagePtr toOverlay(const std_msgs::Header& header, const SequenceMatch& match,
                                OverlayStyle style);

}  // namespace ktgp_orb
