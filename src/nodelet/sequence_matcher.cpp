#include "sequence_matcher.h"

#include <cv_bridge/cv_bridge.h>

#include <boost/make_shared.hpp>
#include <opencv2/imgcodecs.hpp>

#include "image_conversion.h"
#include "message_conversion.h"

namespace ktgp_orb {

SequenceMatcher::SequenceMatcher(const Configuration& configuration)
    : configuration_(configuration),
      extractor_(configuration.orb),
      matcher_(configuration.matcher) {
  keeper_.setOptions(configuration.reference);
}

void SequenceMatcher::configure(const Configuration& configuration) {
  KtgpMatcher matcher(configuration.matcher);  // both before any change: either may throw
  if (configuration.orb != configuration_.orb) extractor_ = OrbExtractor(configuration.orb);
  matcher_ = std::move(matcher);
  keeper_.setOptions(configuration.reference);
  configuration_ = configuration;
}

FramePtr SequenceMatcher::referenceFor(const FramePtr& frame) {
  FramePtr reference = keeper_.referenceFor(*frame);
  if (reference && reference->orb != extractor_.options()) extractAgain(extractor_, *reference);
  return reference;
}

void SequenceMatcher::match(const FramePtr& frame, FramePtr& reference) {
  matcher_.match(reference->features, frame->features, result_);
  if (!keeper_.tryAgain(*frame, result_)) return;
  reference = referenceFor(frame);
  matcher_.match(reference->features, frame->features, result_);
}

FrameMessages SequenceMatcher::process(const sensor_msgs::ImageConstPtr& image, bool draw_overlay) {
  const FramePtr frame = makeFrame(image, extractor_);
  FramePtr reference = referenceFor(frame);
  const MatchResult* result = nullptr;
  if (reference) {
    match(frame, reference);
    result = &result_;
  }
  keeper_.advance(frame, result);

  FrameMessages messages;
  messages.statistics = toStatistics(reference.get(), *frame, result);
  messages.statistics->reference_changed = reference != last_reference_;
  messages.statistics->configuration = configuration_.number;
  last_reference_ = reference;
  if (!reference) return messages;
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

void SequenceMatcher::setFixedReference(const sensor_msgs::ImageConstPtr& image) {
  keeper_.setFixed(makeFrame(image, extractor_));
}

sensor_msgs::ImageConstPtr readImageFile(const std::string& path) {
  cv_bridge::CvImage image;
  image.image = cv::imread(path, cv::IMREAD_GRAYSCALE);
  image.encoding = "mono8";
  if (image.image.empty()) {
    throw RefusedImage("reference_image '" + path + "' cannot be read as an image");
  }
  return image.toImageMsg();
}

}  // namespace ktgp_orb
