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

/// The messages about one frame. Those that may be null are so for a frame without a reference.
struct FrameMessages {
  CorrespondencesPtr correspondences;  ///< may be null
  HomographyStampedPtr homography;
  HomographyStampedPtr accumulated_homography;  ///< null unless the chain of frames is unbroken
  MatchStatisticsPtr statistics;
  sensor_msgs::ImagePtr overlay;  ///< null unless asked for
  /// The reference came through the camera's lens; false: from a file or a topic, taken as it is.
  bool reference_of_camera = true;
  /// Of the frame, whether or not it bettered the homography; valid until the next one. May be
  /// null.
  const AlignmentResult* alignment = nullptr;
};

/// All but the overlay; `header`: of the target image. What only the caller knows of the statistics
/// (latency, counters, configuration) is left at zero.
FrameMessages toMessages(const std_msgs::Header& header, const SequenceMatch& match);

/// All but the picture in one message: as they are, so call it when the statistics are complete.
MatchPtr toMatch(const FrameMessages& messages);

/// A sentence for people.
std::string explanation(NoReference reason);

/// The overlay picture (bgr8) with the header of the target; without a reference: why there is
/// none.
sensor_msgs::ImagePtr toOverlay(const std_msgs::Header& header, const SequenceMatch& match,
                                OverlayStyle style);

}  // namespace ktgp_orb
