// Extraction from an image of any size, stride and content, with any options.
#include <stdexcept>

#include "input.h"
#include "instruction_sets.h"

namespace ktgp_orb::fuzz {
namespace {

OrbOptions orbOptions(Input& in) {
  OrbOptions options;
  options.max_features = in.ConsumeIntegralInRange(-1, 3000);
  options.scale_factor = anyDouble(in, 1.0, 2.1);
  options.levels = in.ConsumeIntegralInRange(0, 17);
  options.fast_threshold = in.ConsumeIntegralInRange(0, 256);
  options.descriptor = in.ConsumeBool() ? DescriptorKind::teblid : DescriptorKind::orb;
  options.distribution =
      in.ConsumeBool() ? KeypointDistribution::uniform : KeypointDistribution::ranked;
  options.keypoints_per_cell = in.ConsumeIntegralInRange(0, 64);
  options.images =
      in.PickValueInArray({ImageKeeping::none, ImageKeeping::copy, ImageKeeping::share});
  options.threads = in.ConsumeIntegralInRange(1, 2);
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
  for (const cv::KeyPoint& keypoint : features.keypoints) {
    require(keypoint.pt.x >= 0.0F && keypoint.pt.y >= 0.0F &&
                keypoint.pt.x < static_cast<float>(features.image_size.width) &&
                keypoint.pt.y < static_cast<float>(features.image_size.height),
            "keypoints lie in the image");
    require(std::isfinite(keypoint.angle) && std::isfinite(keypoint.response), "finite keypoints");
    require(keypoint.octave >= 0 && keypoint.octave < 16, "levels of the pyramid");
  }
  require(mask.empty() || cv::countNonZero(mask) > 0 || features.empty(), "nothing where masked");
}

void run(Input& in) {
  const OrbOptions options = orbOptions(in);
  const cv::Size size(in.ConsumeIntegralInRange(0, 140), in.ConsumeIntegralInRange(0, 140));
  const int beyond = in.ConsumeIntegralInRange(0, 40);
  const bool masked = in.ConsumeIntegralInRange(0, 3) == 0;
  const cv::Mat picture = image(in, size, beyond);
  const cv::Mat mask = masked ? image(in, size, in.ConsumeIntegralInRange(0, 9)) : cv::Mat();
  OrbExtractor extractor(options);
  Features features, again;
  extractor.extract(picture, mask, features);
  requireSound(features, mask);
  extractor.extract(picture, mask, again);
  requireEqual(features, again, "the same answer twice");
  test::forEachInstructionSet([&] {
    OrbExtractor(options).extract(picture, mask, again);
    requireEqual(features, again, "the same answer with every instruction set");
  });
}

}  // namespace
}  // namespace ktgp_orb::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  ktgp_orb::fuzz::Input in(bytes, size);
  try {
    ktgp_orb::fuzz::run(in);
  } catch (const std::invalid_argument&) {  // options or a mask that are said to be refused
  }
  return 0;
}
