#pragma once

#include <ktgp_orb/Correspondences.h>
#include <ktgp_orb/HomographyStamped.h>
#include <ktgp_orb/MatchStatistics.h>
#include <sensor_msgs/Image.h>

#include <optional>

#include "frame.h"
#include "ktgp_orb/ktgp_matcher.h"
#include "ktgp_orb/orb_extractor.h"
#include "parameters.h"
#include "reference_keeper.h"

namespace ktgp_orb {

/// The messages about one frame. Only the statistics are there for a frame without a reference.
struct FrameMessages {
  CorrespondencesPtr correspondences;
  HomographyStampedPtr homography;
  HomographyStampedPtr accumulated_homography;  ///< null unless the chain of frames is unbroken
  MatchStatisticsPtr statistics;
  sensor_msgs::ImagePtr overlay;  ///< null unless asked for
};

/// Matches the images of one stream in turn, each with one configuration from start to end.
/// Not for use by several threads at once.
class SequenceMatcher {
 public:
  /// Throws std::invalid_argument for options the core refuses, and then changes nothing.
  explicit SequenceMatcher(const Configuration& configuration);
  void configure(const Configuration& configuration);
  const Configuration& configuration() const { return configuration_; }

  /// Throws RefusedImage for an image of no use; the reference is then what it was.
  FrameMessages process(const sensor_msgs::ImageConstPtr& image, bool draw_overlay);

  /// Makes `image` the reference of the fixed mode. Throws RefusedImage.
  void setFixedReference(const sensor_msgs::ImageConstPtr& image);

  /// Forgets the reference, but not a fixed one.
  void forgetReference() { keeper_.reset(); }
  /// Forgets the fixed reference too.
  void reset() { keeper_.clear(); }

 private:
  FramePtr referenceFor(const FramePtr& frame);
  void match(const FramePtr& frame, FramePtr& reference);
  HomographyStampedPtr accumulatedHomography(const Frame& frame) const;

  Configuration configuration_;
  OrbExtractor extractor_;
  KtgpMatcher matcher_;
  ReferenceKeeper keeper_;
  FramePtr last_reference_;
  MatchResult result_;
};

/// An image file as a message with stamp zero. Throws RefusedImage naming the file.
sensor_msgs::ImageConstPtr readImageFile(const std::string& path);

}  // namespace ktgp_orb
