#pragma once

#include <sensor_msgs/Image.h>

#include "ktgp_orb/sequence_matcher.h"
#include "ros/configuration.h"
#include "ros/frame_maker.h"
#include "ros/message_conversion.h"

namespace ktgp_orb {

/// Converts image messages to frames and matches them with the node's parameters. Not thread-safe.
class MessageMatcher {
 public:
  /// The constructor and configure() throw std::invalid_argument for options that the core refuses,
  /// and RefusedImage for an unusable reference image. If configure() throws, it has changed
  /// nothing.
  explicit MessageMatcher(const Configuration& configuration);
  void configure(const Configuration& configuration);
  const Configuration& configuration() const { return configuration_; }

  /// Matches an image. If the image is unusable, throws RefusedImage and keeps the reference.
  MatchedFrame process(const sensor_msgs::ImageConstPtr& image);
  /// Like process() above, for an image that is already a frame. `ahead`: see
  /// SequenceMatcher::match.
  MatchedFrame process(const std_msgs::Header& header, const FramePtr& frame, MatchAhead* ahead);
  /// The overlay of the last processed frame. `image`: the message of this frame; the overlay needs
  /// its colours. Returns null if no frame was processed since the last reset.
  sensor_msgs::ImagePtr overlay(const sensor_msgs::ImageConstPtr& image) const;

  /// Makes the next frame the reference of the fixed mode.
  void fixNextFrame() { sequence_.fixNextFrame(); }
  /// The reference of the fixed mode; null if there is none.
  FrameConstPtr fixedReference() const { return sequence_.fixedReference(); }

  ViewsState viewsState() const { return sequence_.viewsState(); }

  /// Returns true if the reference of the fixed mode is a frame of the camera and not the
  /// configured image. Compares the addresses of the pixels, because new options replace the frame
  /// object but not its pixels.
  bool holdsSetReference() const {
    const FrameConstPtr fixed = fixedReference();
    return fixed &&
           !(configured_reference_ && fixed->image.data == configured_reference_->image.data);
  }

  /// Forgets the reference, except the reference of the fixed mode.
  void forgetReference();
  /// Forgets all references; then uses the configured reference image for the fixed mode again.
  void reset();

 private:
  FramePtr configuredReference(const Configuration& configuration);
  void fixReference(const FramePtr& frame);

  Configuration configuration_;
  SequenceMatcher sequence_;
  FrameConstPtr configured_reference_;  // reference from the parameter reference_image
  FrameMaker frame_maker_;
  const SequenceMatch* last_ = nullptr;
};

}  // namespace ktgp_orb
