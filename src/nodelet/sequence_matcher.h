#pragma once

#include <ktgp_orb/Correspondences.h>
#include <ktgp_orb/HomographyStamped.h>
#include <ktgp_orb/MatchStatistics.h>
#include <sensor_msgs/Image.h>

#include <optional>

#include "ktgp_orb/ktgp_matcher.h"
#include "ktgp_orb/orb_extractor.h"
#include "nodelet/frame.h"
#include "nodelet/parameters.h"
#include "nodelet/reference_keeper.h"

namespace ktgp_orb {

/// The messages about one frame. Only the statistics are there for a frame without a reference.
struct FrameMessages {
  CorrespondencesPtr correspondences;
  HomographyStampedPtr homography;
  HomographyStampedPtr accumulated_homography;  ///< null unless the chain of frames is unbroken
  MatchStatisticsPtr statistics;
  sensor_msgs::ImagePtr overlay;  ///< null unless asked for
};

/// A match made ahead of its turn, to save the time when the turn comes.
struct MatchAhead {
  FramePtr reference;
  MatchResult result;
};

/// Matches the images of one stream in turn, each with one configuration from start to end.
/// Not for use by several threads at once.
class SequenceMatcher {
 public:
  /// Throws std::invalid_argument for options the core refuses and RefusedImage for a reference
  /// image of no use; `configure` then changes nothing.
  explicit SequenceMatcher(const Configuration& configuration);
  void configure(const Configuration& configuration);
  const Configuration& configuration() const { return configuration_; }

  /// Throws RefusedImage for an image of no use; the reference is then what it was.
  FrameMessages process(const sensor_msgs::ImageConstPtr& image, bool draw_overlay);
  /// The same for a frame whose features were found with the options of this configuration.
  /// `ahead`, where not null, is used up in place of matching to the reference it names.
  FrameMessages process(const FramePtr& frame, bool draw_overlay, MatchAhead* ahead = nullptr);

  /// The next frame becomes the reference of the fixed mode.
  void fixNextFrame() { fix_next_frame_ = true; }
  /// The reference of the fixed mode, or null.
  const FramePtr& fixedReference() const { return keeper_.fixed(); }

  /// Forgets the reference, but not a fixed one.
  void forgetReference() { keeper_.forget(); }
  /// Forgets every reference; the fixed one becomes the configuration's reference image again.
  void reset();

 private:
  void match(const Frame& frame, FramePtr& reference, MatchAhead* ahead);
  void tryFrameBefore(const Frame& frame, FramePtr& reference);
  const FramePtr& withFeatures(const FramePtr& reference);
  HomographyStampedPtr accumulatedHomography(const Frame& frame) const;

  Configuration configuration_;
  OrbExtractor extractor_;
  KtgpMatcher matcher_;
  ReferenceKeeper keeper_;
  FramePtr last_reference_;
  bool fix_next_frame_ = false;
  MatchResult result_;
  MatchResult other_result_;
  double lost_milliseconds_ = 0.0;  // spent on a match to another reference than the one reported
};

}  // namespace ktgp_orb
