#include "ros/message_matcher.h"

#include "ros/image_conversion.h"

namespace ktgp_orb {

MessageMatcher::MessageMatcher(const Configuration& configuration)
    : configuration_(configuration),
      sequence_(configuration.sequence),
      frame_maker_(configuration.stretch, configuration.view) {
  fixReference(configuredReference(configuration));
}

FramePtr MessageMatcher::configuredReference(const Configuration& configuration) {
  if (!configuration.reference_image) return nullptr;
  if (configuration.reference_frame) return configuration.reference_frame;
  FramePtr frame = sequence_.newFrame();
  toFrame(configuration.reference_image, configuration.stretch, *frame);
  return frame;
}

void MessageMatcher::fixReference(const FramePtr& frame) {
  sequence_.setFixedReference(frame);
  configured_reference_ = frame;
}

void MessageMatcher::configure(const Configuration& configuration) {
  // First make all calls that may throw, so that nothing is changed if one of them throws.
  const bool found_anew = configuration.reference_frame &&
                          configuration.reference_frame != configuration_.reference_frame;
  const bool another = configuration.reference_image != configuration_.reference_image ||
                       (found_anew && !holdsSetReference());
  const FramePtr reference = another ? configuredReference(configuration) : nullptr;
  sequence_.setOptions(configuration.sequence);
  if (another) fixReference(reference);
  frame_maker_ = FrameMaker(configuration.stretch, configuration.view);
  configuration_ = configuration;
}

MatchedFrame MessageMatcher::process(const sensor_msgs::ImageConstPtr& image) {
  const FramePtr frame = sequence_.newFrame();
  frame_maker_.make(image, *frame);
  return process(image->header, frame, nullptr);
}

MatchedFrame MessageMatcher::process(const std_msgs::Header& header, const FramePtr& frame,
                                     MatchAhead* ahead) {
  last_ = nullptr;
  last_ = &sequence_.match(frame, ahead);
  MatchedFrame matched{header, *last_, configuration_.number};
  matched.has_rectified_image = configuration_.view.pixels == Pixels::rectified;
  return matched;
}

sensor_msgs::ImagePtr MessageMatcher::overlay(const sensor_msgs::ImageConstPtr& image) const {
  return last_ != nullptr ? toOverlay(image, *last_, configuration_.overlay_style) : nullptr;
}

void MessageMatcher::forgetReference() {
  last_ = nullptr;
  sequence_.restart();
}

void MessageMatcher::reset() {
  last_ = nullptr;
  sequence_.reset();
  fixReference(configuredReference(configuration_));
}

}  // namespace ktgp_orb
