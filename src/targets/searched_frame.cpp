#include "targets/searched_frame.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "homography/transform.h"

namespace ktgp_orb::targets {
namespace {

constexpr double kOctave = 2.0;

/// Factor by which a frame is enlarged if small targets are wanted; 1: not enlarged.
double enlargementOf(int longer_side) {
  // Wanted longer side of the enlarged frame, px. A search in a larger frame takes longer and
  // misses large targets.
  constexpr double kEnlarged = 960.0;
  constexpr double kMost = 4.0;
  constexpr double kLeast = 1.25;  // with a smaller factor, hardly any more targets are found
  if (longer_side <= 0) return 1.0;
  const double most = static_cast<double>(SearchedFrame::kLargestFrame) / longer_side;
  const double by = std::min(std::clamp(kEnlarged / longer_side, kOctave, kMost), most);
  return by >= kLeast ? by : 1.0;
}

/// Returns the options for a frame that is enlarged by the factor `by`. Adds enough pyramid levels
/// to shrink the frame once more by this factor (at most by 2), so that large targets are still
/// found. If the factor is larger than 2, edges become softer, so we lower the threshold for
/// corners.
OrbOptions enlarged(OrbOptions options, double by) {
  constexpr int kMostLevels = 16;
  const double octave = std::min(by, kOctave);
  const int more = cvRound(std::log(octave) / std::log(options.scale_factor));
  options.levels = std::min(options.levels + more, kMostLevels);
  options.fast_threshold = std::max(1, cvRound(options.fast_threshold * octave / by));
  return options;
}

/// Returns `size` enlarged by the factor `by`, rounded to whole pixels. The homography to the
/// original frame must use the ratio of the rounded sizes.
cv::Size resized(const cv::Size& size, double by) {
  return {std::max(1, cvRound(by * size.width)), std::max(1, cvRound(by * size.height))};
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
  const double by = wants_small ? enlargementOf(longer) : 1.0;
  own_ = {image};
  features_ = &extracted_;
  if (longer > kLargestFrame) {
    const double shrink = static_cast<double>(kLargestFrame) / longer;
    cv::resize(image, resized_, resized(image.size(), shrink), 0, 0, cv::INTER_AREA);
  } else if (by > 1.0) {
    setEnlargement(by);
    // Linear interpolation would blur the few details of a small frame.
    cv::resize(image, resized_, resized(image.size(), by), 0, 0,
               by > kOctave ? cv::INTER_LANCZOS4 : cv::INTER_LINEAR);
  } else {
    resized_ = image;
  }
  (by > 1.0 ? enlarged_extractor_ : extractor_).extract(resized_, extracted_);
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
