#include "ktgp_orb/orb_extractor.h"

#include <algorithm>
#include <cmath>
#include <opencv2/features2d.hpp>
#include <optional>
#include <stdexcept>
#include <tuple>

#include "core/orb/kernels.h"
#include "core/orb/pipeline.h"
#include "core/orb/pyramid.h"
#include "core/orb/teblid_describer.h"
#include "core/util/options_check.h"

namespace ktgp_orb {
namespace {

using orb::bestOrbKernels;
using orb::kEdgeMargin;
using orb::keypointSizes;
using orb::kPatchSize;
using orb::OrbPipeline;
using orb::OrbPyramid;
using orb::TeblidDescriber;
using util::requireInRange;

void requireValid(const OrbOptions& options) {
  requireInRange("max_features", options.max_features, 1, 1000000);
  requireInRange("scale_factor", options.scale_factor, 1.01, 2.0);
  requireInRange("levels", options.levels, 1, 16);
  requireInRange("fast_threshold", options.fast_threshold, 1, 255);
  requireInRange("keypoints_per_cell", options.keypoints_per_cell, 1, 1000000);
  requireInRange("threads", options.threads, 0, 1024);
  if (options.extractor == ExtractorKind::opencv &&
      options.distribution != KeypointDistribution::ranked) {
    throw std::invalid_argument(
        "extractor opencv has no distribution uniform; expected distribution ranked, or the "
        "package's own extractor (parameter value fast)");
  }
}

void requireValid(const cv::Mat& image, const cv::Mat& mask) {
  if (image.type() != CV_8UC1) {
    throw std::invalid_argument("image is " + cv::typeToString(image.type()) +
                                "; expected 8-bit grey (CV_8UC1)");
  }
  if (mask.empty()) return;
  if (mask.type() != CV_8UC1 || mask.size() != image.size()) {
    throw std::invalid_argument("mask is " + cv::typeToString(mask.type()) + ", " +
                                std::to_string(mask.cols) + "x" + std::to_string(mask.rows) +
                                "; expected CV_8UC1 of the image's size, " +
                                std::to_string(image.cols) + "x" + std::to_string(image.rows));
  }
}

auto asTuple(const OrbOptions& o) {
  return std::tie(o.max_features, o.scale_factor, o.levels, o.fast_threshold, o.extractor,
                  o.descriptor, o.distribution, o.keypoints_per_cell, o.images, o.threads);
}

/// The pyramid levels of an image that are a pixel or more in width and height.
int levelsWithPixels(const cv::Size& image, const OrbOptions& options) {
  const int side = std::min(image.width, image.height);
  const auto scale = [&](int level) {  // rounded as in cv::ORB
    return static_cast<float>(std::pow(static_cast<float>(options.scale_factor), level));
  };
  int levels = 1;
  while (levels < options.levels && cvRound(side / scale(levels)) > 0) ++levels;
  return levels;
}

cv::Ptr<cv::ORB> createOpencv(const OrbOptions& options) {
  return cv::ORB::create(options.max_features, static_cast<float>(options.scale_factor),
                         options.levels, kEdgeMargin, 0, 2, cv::ORB::HARRIS_SCORE, kPatchSize,
                         options.fast_threshold);
}

// cv::ORB; TEBLID descriptors replace its own where they are wanted.
class OpencvExtractor {
 public:
  explicit OpencvExtractor(const OrbOptions& o) : orb_(createOpencv(o)) {
    if (o.descriptor == DescriptorKind::teblid) {
      teblid_.emplace(keypointSizes(kPatchSize, static_cast<float>(o.scale_factor), o.levels));
    }
  }

  void setLevels(int levels) { orb_->setNLevels(levels); }

  void extract(const cv::Mat& image, const cv::Mat& mask, Features& features) {
    if (!teblid_) {
      orb_->detectAndCompute(image, mask, features.keypoints, features.descriptors);
      return;
    }
    orb_->detect(image, features.keypoints, mask);
    features.descriptors = cv::Mat(static_cast<int>(features.size()), kDescriptorBytes, CV_8U);
    teblid_->setImage(image);
    for (std::size_t i = 0; i < features.size(); ++i) {
      teblid_->describe(features.keypoints[i], features.descriptors.ptr(static_cast<int>(i)));
    }
  }

 private:
  cv::Ptr<cv::ORB> orb_;
  std::optional<TeblidDescriber> teblid_;
};

}  // namespace

bool OrbOptions::operator==(const OrbOptions& other) const {
  return asTuple(*this) == asTuple(other);
}

struct OrbExtractor::Impl {
  explicit Impl(const OrbOptions& o) : options(o) {
    if (o.extractor == ExtractorKind::opencv) {
      opencv = std::make_unique<OpencvExtractor>(o);
      pyramid = std::make_unique<OrbPyramid>(o.max_features, static_cast<float>(o.scale_factor),
                                             o.levels);
    } else {
      pipeline = std::make_unique<OrbPipeline>(o, bestOrbKernels());
    }
  }

  void keepImages(const cv::Mat& image, Features& features) {
    pyramid->setImage(image, cv::Mat());
    pyramid->takeBuffers(features.images);
    pyramid->shrink(bestOrbKernels());
    pyramid->handOut(options.images == ImageKeeping::copy, features.images);
  }

  OrbOptions options;
  std::unique_ptr<OrbPipeline> pipeline;    // either this
  std::unique_ptr<OpencvExtractor> opencv;  // or this,
  std::unique_ptr<OrbPyramid>
      pyramid;  // needed with OpenCV's extractor, which does not return its pyramid
};

OrbExtractor::OrbExtractor(const OrbOptions& options) {
  requireValid(options);
  impl_ = std::make_unique<Impl>(options);
}

OrbExtractor::~OrbExtractor() = default;
OrbExtractor::OrbExtractor(OrbExtractor&&) noexcept = default;
OrbExtractor& OrbExtractor::operator=(OrbExtractor&&) noexcept = default;

const OrbOptions& OrbExtractor::options() const {
  return impl_->options;
}

void OrbExtractor::extract(const cv::Mat& image, Features& features) {
  extract(image, cv::Mat(), features);
}

void OrbExtractor::extract(const cv::Mat& image, const cv::Mat& mask, Features& features) {
  features.image_size = image.size();
  features.descriptor = impl_->options.descriptor;
  features.keypoints.clear();
  if (!image.empty()) requireValid(image, mask);
  // Every level is smaller than a patch.
  if (std::min(image.cols, image.rows) < 2 * kEdgeMargin + 1) {
    features.descriptors.release();
    features.images.clear();
    return;
  }
  if (impl_->options.images == ImageKeeping::none) features.images.clear();
  if (impl_->opencv) {
    // cv::ORB throws if a level has no pixels.
    impl_->opencv->setLevels(levelsWithPixels(image.size(), impl_->options));
    impl_->opencv->extract(image, mask, features);
    if (impl_->options.images != ImageKeeping::none) impl_->keepImages(image, features);
  } else {
    impl_->pipeline->extract(image, mask, features);
  }
}

}  // namespace ktgp_orb
