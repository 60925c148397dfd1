#include "targets/searched_frame.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "core/homography/transform.h"

namespace ktgp_orb::targets {
namespace {

constexpr double kOctave = 2.0;

/// How much larger a frame becomes in which small targets are wanted.
double enlargementOf(int longer_side) {
  constexpr double kEnlarged = 960.0;  // px; more takes time, and loses large targets
  constexpr double kMost = 4.0;
  return std::clamp(kEnlarged / longer_side, kOctave, kMost);
}

/// With the levels that an octave adds, large targets are reached as before. More enlargement makes
/// edges softer.
OrbOptions enlarged(OrbOptions options, double by) {
  constexpr int kMostLevels = 16;
  const int octave = cvRound(std::log(kOctave) / std::log(options.scale_factor));
  options.levels = std::min(options.levels + octave, kMostLevels);
  options.fast_threshold = std::max(1, cvRound(options.fast_threshold * kOctave / by));
  return options;
}

}  // namespace

SearchedFrame::SearchedFrame(const TargetFinderOptions& options)
    : extractor_(options.orb), enlarged_extractor_(options.orb) {}

void SearchedFrame::setEnlargement(double by) {
  if (by == enlargement_) return;
  enlargement_ = by;
  enlarged_extractor_ = OrbExtractor(enlarged(extractor_.options(), by));
}

void SearchedFrame::set(const cv::Mat& image, bool wants_small) {
  const int longer = std::max(image.cols, image.rows);
  const bool is_larger = wants_small && longer > 0 && kOctave * longer <= kLargestFrame;
  own_ = {image};
  features_ = &extracted_;
  if (longer > kLargestFrame) {
    const double shrink = static_cast<double>(kLargestFrame) / longer;
    const cv::Size size(std::max(1, cvRound(shrink * image.cols)),
                        std::max(1, cvRound(shrink * image.rows)));
    cv::resize(image, resized_, size, 0, 0, cv::INTER_AREA);
  } else if (is_larger) {
    setEnlargement(enlargementOf(longer));
    // Linear interpolation would blur what little a small frame has.
    cv::resize(image, resized_, cv::Size(), enlargement_, enlargement_,
               enlargement_ > kOctave ? cv::INTER_LANCZOS4 : cv::INTER_LINEAR);
  } else {
    resized_ = image;
  }
  (is_larger ? enlarged_extractor_ : extractor_).extract(resized_, extracted_);
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
