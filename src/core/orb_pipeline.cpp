#include "orb_pipeline.h"

#include <cmath>
#include <opencv2/features2d.hpp>

#include "orb_blur.h"

namespace ktgp_orb {
namespace {

constexpr float kPatchSize = 31.f;
constexpr int kVectorSlack = 64;  // bytes the kernels may write beyond a row

}  // namespace

OrbPipeline::OrbPipeline(const OrbOptions& options, const OrbKernels& kernels)
    : options_(options),
      kernels_(kernels),
      pyramid_(options.features, static_cast<float>(options.scale_factor), options.levels),
      levels_(options.levels) {}

void OrbPipeline::extract(const cv::Mat& image, const cv::Mat& mask, Features& features) {
  pyramid_.setImage(image, mask);
  pyramid_.shrink(kernels_);
  for (int level = 0; level < pyramid_.used(); ++level) {
    detect(level);
    blur(level);
  }
  describe(features);
}

void OrbPipeline::detect(int level) {
  const PyramidLevel& source = pyramid_.levels()[level];
  std::vector<cv::KeyPoint>& keypoints = levels_[level].keypoints;
  keypoints.clear();
  fastCorners(source.image, kEdgeMargin, source.image.rows - kEdgeMargin, options_.fast_threshold,
              kernels_, fast_scratch_, keypoints);
  cv::KeyPointsFilter::runByPixelsMask(keypoints, source.mask);
  // FAST's score is a poor rank: it only makes the first choice, of twice as many as are wanted.
  cv::KeyPointsFilter::retainBest(keypoints, 2 * source.features_quota);
  scoreByHarris(source.image, kernels_, keypoints);
  cv::KeyPointsFilter::retainBest(keypoints, source.features_quota);
  orient(source.image, kernels_, keypoints);
}

void OrbPipeline::blur(int level) {
  const cv::Mat& image = pyramid_.levels()[level].image;
  cv::Mat& blurred = levels_[level].blurred;
  blurred.create(image.rows, image.cols + kVectorSlack, CV_8U);
  blurRows(image, kBlurMargin, image.rows - kBlurMargin, kernels_, blur_scratch_, blurred);
}

void OrbPipeline::describe(Features& features) {
  int count = 0;
  for (int level = 0; level < pyramid_.used(); ++level) {
    count += static_cast<int>(levels_[level].keypoints.size());
  }
  features.descriptors.create(count, kDescriptorBytes, CV_8U);
  for (int level = 0; level < pyramid_.used(); ++level) {
    const cv::Mat& blurred = levels_[level].blurred;
    const float scale = pyramid_.levels()[level].scale;
    for (cv::KeyPoint keypoint : levels_[level].keypoints) {
      const auto row = static_cast<int>(features.keypoints.size());
      const float angle = keypoint.angle * static_cast<float>(CV_PI / 180.);
      const auto x = static_cast<int>(keypoint.pt.x);
      const auto y = static_cast<int>(keypoint.pt.y);
      kernels_.describe(blurred.ptr<std::uint8_t>(y) + x, static_cast<std::ptrdiff_t>(blurred.step),
                        std::cos(angle), std::sin(angle), features.descriptors.ptr(row));
      keypoint.octave = level;
      keypoint.size = kPatchSize * scale;
      keypoint.pt *= scale;
      features.keypoints.push_back(keypoint);
    }
  }
}

}  // namespace ktgp_orb
