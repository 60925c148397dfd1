#include "ktgp_orb/orb_extractor.h"

#include <stdexcept>
#include <tuple>

#include "features/orb/image_check.h"
#include "features/orb/kernels.h"
#include "features/orb/pipeline.h"
#include "util/format.h"
#include "util/options_check.h"

namespace ktgp_orb {
namespace {

using util::requireInRange;

void requireValid(const OrbOptions& options) {
  requireInRange("max_features", options.max_features, 1, 1000000);
  requireInRange("scale_factor", options.scale_factor, 1.01, 2.0);
  requireInRange("levels", options.levels, 1, 16);
  requireInRange("first_level", options.first_level, 0, options.levels - 1);
  if (options.first_level != 0 && options.descriptor == DescriptorKind::teblid) {
    throw std::invalid_argument("first_level is " + std::to_string(options.first_level) +
                                " with the descriptor teblid; expected 0");
  }
  requireInRange("fast_threshold", options.fast_threshold, 1, 255);
  requireInRange("keypoints_per_cell", options.keypoints_per_cell, 1, 1000000);
  requireInRange("threads", options.threads, 0, 1024);
}

auto asTuple(const OrbOptions& o) {
  return std::tie(o.max_features, o.scale_factor, o.levels, o.first_level, o.fast_threshold,
                  o.fast_adaptive, o.descriptor, o.distribution, o.keypoints_per_cell, o.images,
                  o.threads);
}

}  // namespace

void orb::requireValid(const cv::Mat& image, const cv::Mat& mask) {
  if (image.type() != CV_8UC1) {
    throw std::invalid_argument("image is " + cv::typeToString(image.type()) +
                                "; expected 8-bit grey (CV_8UC1)");
  }
  if (mask.empty()) return;
  if (mask.type() != CV_8UC1 || mask.size() != image.size()) {
    throw std::invalid_argument(
        "mask is " + cv::typeToString(mask.type()) + ", " + util::text(mask.size()) +
        "; expected CV_8UC1 of the image's size, " + util::text(image.size()));
  }
}

bool OrbOptions::operator==(const OrbOptions& other) const {
  return asTuple(*this) == asTuple(other);
}

OrbExtractor::OrbExtractor(const OrbOptions& options) {
  requireValid(options);
  pipeline_ = std::make_unique<orb::OrbPipeline>(options, orb::bestOrbKernels());
}

OrbExtractor::~OrbExtractor() = default;
OrbExtractor::OrbExtractor(OrbExtractor&&) noexcept = default;
OrbExtractor& OrbExtractor::operator=(OrbExtractor&&) noexcept = default;

const OrbOptions& OrbExtractor::options() const {
  return pipeline_->options();
}

void OrbExtractor::extract(const cv::Mat& image, Features& features) {
  extract(image, cv::Mat(), features);
}

void OrbExtractor::extract(const cv::Mat& given, const cv::Mat& mask, Features& features) {
  const cv::Mat image = given;  // `given` may be in features.images, which is cleared below
  if (!image.empty()) orb::requireValid(image, mask);
  features.image_size = image.size();
  features.descriptor = options().descriptor;
  features.keypoints.clear();
  if (options().images == ImageKeeping::none) features.images.clear();
  if (pipeline_->extract(image, mask, features)) return;
  features.descriptors.release();
  features.images.clear();
}

}  // namespace ktgp_orb
