#pragma once

#include <sensor_msgs/Image.h>

#include "ktgp_orb/sequence_matcher.h"
#include "ros/configuration.h"
#include "ros/frame_maker.h"
#include "ros/message_conversion.h"

namespace ktgp_orb {

/// Warning if things stand still in most frames (MatchResult::still).
constexpr const char* kThingsStandStill =
    "things stand still in the image while the scene moves: hot pixels, dirt on the lens, text or "
    "a "
    "part of the vehicle; hide them with mask_image";

/// Runs the sequence matcher on messages, with the node's parameters. Not thread-safe.
class MessageMatcher {
 public:
  /// Throws std::invalid_argument for options that the core refuses, and RefusedImage for an
  /// unusable reference image; `configure` then changes nothing.
  explicit MessageMatcher(const Configuration& configuration);
  void configure(const Configuration& configuration);
  const Configuration& configuration() const { return configuration_; }

  /// Throws RefusedImage for an unusable image, and then keeps the reference.
  MatchedFrame process(const sensor_msgs::ImageConstPtr& image);
  /// Like process() above, for a frame. `ahead`: see SequenceMatcher::match.
  MatchedFrame process(const std_msgs::Header& header, const FramePtr& frame, MatchAhead* ahead);
  /// The overlay of the last processed frame, in the colours of its `image`; null if no frame was
  /// processed since the last reset.
  sensor_msgs::ImagePtr overlay(const sensor_msgs::ImageConstPtr& image) const;

  /// The next frame becomes the reference of the fixed mode.
  void fixNextFrame() { sequence_.fixNextFrame(); }
  /// The reference of the fixed mode, or null.
  FrameConstPtr fixedReference() const { return sequence_.fixedReference(); }

  ViewsState viewsState() const { return sequence_.viewsState(); }

  /// Whether the reference of the fixed mode is a frame of the camera and not the configured image.
  /// Compares the addresses of the pixels, because new options replace the frame but not its
  /// pixels.
  bool holdsSetReference() const {
    const FrameConstPtr fixed = fixedReference();
    return fixed &&
           !(configured_reference_ && fixed->image.data == configured_reference_->image.data);
  }

  /// Forgets the reference, unless it is fixed.
  void forgetReference();
  /// Forgets every reference; the configured reference image becomes the fixed reference again.
  void reset();

 private:
  FramePtr configuredReference(const Configuration& configuration);
  void fixReference(const FramePtr& frame);

  Configuration configuration_;
  SequenceMatcher sequence_;
  FrameConstPtr configured_reference_;  // fixed reference from the parameters, not from the camera
  FrameMaker frame_maker_;
  const SequenceMatch* last_ = nullptr;
};

}  // namespace ktgp_orb
