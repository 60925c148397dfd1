// Sub-pixel alignment: any homography between any two pictures, with right and wrong matches.
#include <stdexcept>

#include "input.h"
#include "instruction_sets.h"

namespace ktgp_orb::fuzz {
namespace {

Eigen::Matrix3d homography(Input& in) {
  Eigen::Matrix3d h = Eigen::Matrix3d::Identity();
  for (int i = 0; i < 9; ++i) {
    const double unit = i % 3 == 2 && i < 8 ? 20.0 : (i == 6 || i == 7 ? 2e-3 : 0.3);
    h(i / 3, i % 3) += anyDouble(in, -unit, unit);
  }
  return h;
}

std::vector<Correspondence> matches(Input& in, const Features& reference, const Features& target) {
  std::vector<Correspondence> all;
  if (reference.empty() || target.empty()) return all;
  std::minstd_rand random(in.ConsumeIntegral<std::uint16_t>() + 1U);
  const int count = in.ConsumeIntegralInRange(0, 200);
  const bool wrong = in.ConsumeIntegralInRange(0, 31) == 0;
  for (int i = 0; i < count; ++i) {
    all.push_back({static_cast<std::int32_t>(random() % reference.size()),
                   static_cast<std::int32_t>(random() % target.size()), 10, 20, Level::ktgp,
                   false});
  }
  if (wrong && !all.empty()) all.back().target_index = in.ConsumeIntegral<std::int32_t>();
  return all;
}

void run(Input& in) {
  AlignmentOptions options;
  options.points = in.ConsumeIntegralInRange(12, 300);
  OrbOptions orb;
  orb.max_features = 300;
  orb.levels = in.ConsumeIntegralInRange(1, 8);
  OrbExtractor extractor(orb);
  const cv::Size size(in.ConsumeIntegralInRange(63, 200), in.ConsumeIntegralInRange(63, 200));
  Features reference, target;
  extractor.extract(image(in, size), reference);
  if (in.ConsumeBool()) {
    target = reference;
  } else {
    extractor.extract(image(in, {in.ConsumeIntegralInRange(1, 200), size.height}), target);
  }
  if (in.ConsumeIntegralInRange(0, 15) == 0) target.images.clear();
  // Keypoints of a message may lie anywhere.
  for (cv::KeyPoint& keypoint : reference.keypoints) {
    if (in.remaining_bytes() > 8) keypoint.pt.x = coordinate(in, size.width);
  }
  const Eigen::Matrix3d h = homography(in);
  const auto pairs = matches(in, reference, target);
  const Covariance8 covariance = Covariance8::Identity();
  AlignmentResult result, again;
  Alignment alignment(options);
  alignment.align(reference, target, pairs, h, covariance, result);
  if (h.allFinite()) require(result.homography.allFinite(), "H is finite");
  if (result.status != AlignmentStatus::ok && result.status != AlignmentStatus::not_run) {
    require(!h.allFinite() || result.homography == h, "H is the one handed in unless ok");
  }
  require(result.tried <= static_cast<std::size_t>(options.points),
          "no more points than asked for");
  require(result.points.size() + result.outside + result.distorted + result.textureless +
                  result.unsettled + result.beyond_reach + result.uncorrelated ==
              result.tried,
          "each point is in exactly one count");
  for (const AlignedPoint& point : result.points) {
    require(point.match < pairs.size(), "points are of matches");
    require(point.target.allFinite() && point.correlation >= 0.5 && point.correlation <= 1.0 + 1e-9,
            "points are where the images agree");
  }
  test::forEachInstructionSet([&] {
    Alignment(options).align(reference, target, pairs, h, covariance, again);
    require(again.status == result.status && again.points.size() == result.points.size(),
            "the same answer with every instruction set");
    require(!h.allFinite() || again.homography == result.homography,
            "the same H with every instruction set");
  });
}

}  // namespace
}  // namespace ktgp_orb::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  ktgp_orb::fuzz::Input in(bytes, size);
  try {
    ktgp_orb::fuzz::run(in);
  } catch (const std::invalid_argument&) {  // an index outside its frame
  }
  return 0;
}
