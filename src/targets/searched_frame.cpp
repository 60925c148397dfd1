#include "targets/searched_frame.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "core/homography/transform.h"

namespace ktgp_orb::targets {
namespace {

constexpr double kLarger = 2.0;  // one octave

/// With the levels that the octave adds, large targets are reached as before.
OrbOptions withOctave(OrbOptions options) {
  constexpr int kMostLevels = 16;
  const int octave = cvRound(std::log(kLarger) / std::log(options.scale_factor));
  options.levels = std::min(options.levels + octave, kMostLevels);
  return options;
}

}  // namespace

SearchedFrame::SearchedFrame(const TargetFinderOptions& options)
    : extractor_(options.orb), small_extractor_(withOctave(options.orb)) {}

void SearchedFrame::set(const cv::Mat& image, bool wants_small) {
  const int longer = std::max(image.cols, image.rows);
  const bool is_larger = wants_small && kLarger * longer <= kLargestFrame;
  own_ = {image};
  features_ = &extracted_;
  if (longer > kLargestFrame) {
    const double shrink = static_cast<double>(kLargestFrame) / longer;
    cv::resize(image, resized_, cv::Size(), shrink, shrink, cv::INTER_AREA);
  } else if (is_larger) {
    cv::resize(image, resized_, cv::Size(), kLarger, kLarger, cv::INTER_LINEAR);
  } else {
    resized_ = image;
  }
  (is_larger ? small_extractor_ : extractor_).extract(resized_, extracted_);
  scale_ = static_cast<double>(resized_.cols) / std::max(1, image.cols);
  to_frame_ = homography::resizing(resized_.size(), image.size());
}

void SearchedFrame::set(const Features& features) {
  features_ = &features;
  own_.clear();
  scale_ = 1.0;
  to_frame_.setIdentity();
}

}  // namespace ktgp_orb::targets
