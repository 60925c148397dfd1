#include "nodelet/sequence_matcher.h"

#include <boost/make_shared.hpp>
#include <utility>

#include "nodelet/message_conversion.h"

namespace ktgp_orb {

namespace {

FramePtr makeFixedReference(const Configuration& configuration, OrbExtractor& extractor) {
  if (!configuration.reference_image) return nullptr;
  return makeFrame(configuration.reference_image, extractor);
}

double milliseconds(const MatchResult& result) {
  double sum = 0.0;
  for (const StageResult& stage : result.stages) sum += stage.milliseconds;
  return sum;
}

}  // namespace

SequenceMatcher::SequenceMatcher(const Configuration& configuration)
    : configuration_(configuration),
      extractor_(configuration.orb),
      matcher_(configuration.matcher) {
  keeper_.setOptions(configuration.reference);
  keeper_.setFixed(makeFixedReference(configuration, extractor_));
}

void SequenceMatcher::configure(const Configuration& configuration) {
  // All that may throw comes before any change.
  OrbExtractor extractor(configuration.orb);
  KtgpMatcher matcher(configuration.matcher);
  if (configuration.reference_image != configuration_.reference_image) {
    keeper_.setFixed(makeFixedReference(configuration, extractor));
  }
  if (configuration.orb != configuration_.orb) extractor_ = std::move(extractor);
  matcher_ = std::move(matcher);
  keeper_.setOptions(configuration.reference);
  configuration_ = configuration;
}

void SequenceMatcher::reset() {
  keeper_.forget();
  keeper_.setFixed(makeFixedReference(configuration_, extractor_));
  fix_next_frame_ = false;
}

// Features found before the extractor's options changed would mix two configurations.
const FramePtr& SequenceMatcher::withFeatures(const FramePtr& reference) {
  if (reference->orb != extractor_.options()) extractAgain(extractor_, *reference);
  return reference;
}

void SequenceMatcher::match(const Frame& frame, FramePtr& reference, MatchAhead* ahead) {
  lost_milliseconds_ = 0.0;
  if (ahead != nullptr && ahead->reference == reference) {
    result_ = std::move(ahead->result);
  } else {
    matcher_.match(withFeatures(reference)->features, frame.features, result_);
  }
  tryFrameBefore(frame, reference);
}

void SequenceMatcher::tryFrameBefore(const Frame& frame, FramePtr& reference) {
  const FramePtr before = keeper_.secondChoice(frame, result_);
  if (!before) return;
  matcher_.match(withFeatures(before)->features, frame.features, other_result_);
  if (other_result_.status == Status::ok) {
    std::swap(result_, other_result_);
    reference = before;
  }
  lost_milliseconds_ = milliseconds(other_result_);
}

FrameMessages SequenceMatcher::process(const sensor_msgs::ImageConstPtr& image, bool draw_overlay) {
  return process(makeFrame(image, extractor_), draw_overlay);
}

FrameMessages SequenceMatcher::process(const FramePtr& frame, bool draw_overlay,
                                       MatchAhead* ahead) {
  if (std::exchange(fix_next_frame_, false)) keeper_.setFixed(frame);
  FramePtr reference = keeper_.referenceFor(*frame);
  if (reference) match(*frame, reference, ahead);
  const MatchResult* result = reference ? &result_ : nullptr;
  keeper_.advance(frame, reference, result);

  FrameMessages messages;
  messages.statistics = toStatistics(reference.get(), *frame, result);
  messages.statistics->reference_changed = reference != last_reference_;
  messages.statistics->configuration = configuration_.number;
  last_reference_ = reference;
  if (!reference) return messages;
  messages.statistics->total_milliseconds += lost_milliseconds_;
  messages.correspondences = toCorrespondences(*reference, *frame, result_);
  messages.homography = toHomography(*reference, *frame, result_);
  messages.accumulated_homography = accumulatedHomography(*frame);
  if (draw_overlay) messages.overlay = toOverlay(*reference, *frame, result_);
  return messages;
}

HomographyStampedPtr SequenceMatcher::accumulatedHomography(const Frame& frame) const {
  if (!keeper_.accumulated()) return nullptr;
  auto message = boost::make_shared<HomographyStamped>();
  message->header = frame.message->header;
  message->reference_stamp = keeper_.accumulated()->first_stamp;
  message->status = HomographyStamped::STATUS_OK;
  message->inliers = static_cast<std::uint32_t>(result_.prosac.inliers);
  message->reprojection_rmse = result_.prosac.rmse;
  copyHomography(keeper_.accumulated()->homography, *message);
  return message;
}

}  // namespace ktgp_orb
