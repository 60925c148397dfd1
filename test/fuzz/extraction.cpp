// Extraction from an image of any size, stride and content, with any options.

#include "input.h"
#include "one_instruction_set.h"

namespace ktgp_orb::fuzz {
namespace {

OrbOptions orbOptions(Input& in) {
  OrbOptions options;
  options.max_features = few(in, 3000) - (in.ConsumeIntegralInRange(0, 255) == 0 ? 1 : 0);
  options.scale_factor = anyDouble(in, 1.0, 2.1);
  options.levels = in.ConsumeIntegralInRange(0, 17);
  options.fast_threshold = in.ConsumeIntegralInRange(0, 256);
  options.descriptor = in.ConsumeBool() ? DescriptorKind::teblid : DescriptorKind::orb;
  options.distribution =
      in.ConsumeBool() ? KeypointDistribution::uniform : KeypointDistribution::ranked;
  options.keypoints_per_cell = in.ConsumeIntegralInRange(0, 64);
  options.images =
      in.PickValueInArray({ImageKeeping::none, ImageKeeping::copy, ImageKeeping::share});
  options.threads = threads(in);
  return options;
}

void requireEqual(const Features& a, const Features& b, const char* what) {
  require(a.size() == b.size(), what);
  for (std::size_t i = 0; i < a.size(); ++i) {
    require(a.keypoints[i].pt == b.keypoints[i].pt, what);
    require(a.keypoints[i].angle == b.keypoints[i].angle, what);
  }
  require(a.empty() || cv::norm(a.descriptors, b.descriptors, cv::NORM_INF) == 0.0, what);
}

void requireSound(const Features& features, const cv::Mat& mask) {
  requireValid(features, "features");
  require(isWithin(features), "keypoints lie in the image");
  for (const cv::KeyPoint& keypoint : features.keypoints) {
    require(std::isfinite(keypoint.angle) && std::isfinite(keypoint.response), "finite keypoints");
    require(keypoint.octave >= 0 && keypoint.octave < 16, "levels of the pyramid");
  }
  require(mask.empty() || cv::countNonZero(mask) > 0 || features.empty(), "nothing where masked");
}

/// Mostly just large enough for keypoints.
cv::Size imageSize(Input& in) {
  if (in.ConsumeIntegralInRange(0, 15) == 0) {
    return {in.ConsumeIntegralInRange(0, 140), in.ConsumeIntegralInRange(0, 140)};
  }
  return {in.ConsumeIntegralInRange(60, 80), in.ConsumeIntegralInRange(60, 80)};
}

void run(Input& in) {
  const OrbOptions options = orbOptions(in);
  const cv::Size size = imageSize(in);
  const int beyond = in.ConsumeIntegralInRange(0, 40);
  const bool masked = in.ConsumeIntegralInRange(0, 3) == 0;
  const cv::Mat picture = image(in, size, beyond);
  const cv::Mat mask = masked ? image(in, size, in.ConsumeIntegralInRange(0, 9)) : cv::Mat();
  const bool same_extractor = in.ConsumeIntegralInRange(0, 3) == 0;
  // Reused: the result must not depend on old content.
  static Features features, again;
  OrbExtractor extractor(options);
  extractor.extract(picture, mask, features);
  requireSound(features, mask);
  if (same_extractor) {
    extractor.extract(picture, mask, again);
    requireEqual(features, again, "the same answer twice");
  } else {
    const OneInstructionSet one(in);
    OrbExtractor(options).extract(picture, mask, again);
    requireEqual(features, again, "the same answer with every instruction set");
  }
}

}  // namespace
}  // namespace ktgp_orb::fuzz

KTGP_ORB_FUZZ(ktgp_orb::fuzz::run)  // documented refusals of options or masks
