#include "ktgp_orb/orb_extractor.h"

#include <opencv2/features2d.hpp>
#include <stdexcept>

#include "options_check.h"

namespace ktgp_orb {
namespace {

constexpr int kPatchSize = 31;  // side of the descriptor patch in px; also the border left unused

void requireValid(const OrbOptions& options) {
  requireInRange("features", options.features, 1, 1000000);
  requireInRange("scale_factor", options.scale_factor, 1.01, 2.0);
  requireInRange("levels", options.levels, 1, 16);
  requireInRange("fast_threshold", options.fast_threshold, 1, 255);
}

}  // namespace

bool OrbOptions::operator==(const OrbOptions& other) const {
  return features == other.features && scale_factor == other.scale_factor &&
         levels == other.levels && fast_threshold == other.fast_threshold;
}

struct OrbExtractor::Impl {
  OrbOptions options;
  cv::Ptr<cv::ORB> orb;
};

OrbExtractor::OrbExtractor(const OrbOptions& options) : impl_(std::make_unique<Impl>()) {
  requireValid(options);
  impl_->options = options;
  impl_->orb =
      cv::ORB::create(options.features, static_cast<float>(options.scale_factor), options.levels,
                      kPatchSize, 0, 2, cv::ORB::HARRIS_SCORE, kPatchSize, options.fast_threshold);
}

OrbExtractor::~OrbExtractor() = default;
OrbExtractor::OrbExtractor(OrbExtractor&&) noexcept = default;
OrbExtractor& OrbExtractor::operator=(OrbExtractor&&) noexcept = default;

const OrbOptions& OrbExtractor::options() const {
  return impl_->options;
}

void OrbExtractor::extract(const cv::Mat& image, Features& features) {
  features.image_size = image.size();
  features.keypoints.clear();
  if (image.empty()) {
    features.descriptors.release();
    return;
  }
  if (image.type() != CV_8UC1) {
    throw std::invalid_argument("image is " + cv::typeToString(image.type()) +
                                "; expected 8-bit grey (CV_8UC1)");
  }
  impl_->orb->detectAndCompute(image, cv::noArray(), features.keypoints, features.descriptors);
}

}  // namespace ktgp_orb
