// All stages over features as a message would hold them, of two frames that may show the same.
#include <Eigen/LU>
#include <stdexcept>

#include "instruction_sets.h"
#include "invariants.h"

namespace ktgp_orb::fuzz {
namespace {

/// The reference's features moved and shuffled, some of their bits changed.
Features moved(Input& in, const Features& reference) {
  Features target = reference;
  target.descriptors = reference.descriptors.clone();
  const double angle = in.ConsumeFloatingPointInRange(-3.2, 3.2);
  const double scale = in.ConsumeFloatingPointInRange(0.3, 3.0);
  const double tilt = in.ConsumeFloatingPointInRange(-1e-3, 1e-3);
  Eigen::Matrix3d h;
  h << scale * std::cos(angle), -scale * std::sin(angle),
      in.ConsumeFloatingPointInRange(-300.0, 300.0), scale * std::sin(angle),
      scale * std::cos(angle), in.ConsumeFloatingPointInRange(-300.0, 300.0), tilt, 0.0, 1.0;
  const unsigned noise = in.ConsumeIntegralInRange(0U, 30U);
  std::minstd_rand random(in.ConsumeIntegral<std::uint16_t>() + 1U);
  for (std::size_t i = 0; i < target.size(); ++i) {
    const cv::Point2f& p = reference.keypoints[i].pt;
    const Eigen::Vector2d q = (h * Eigen::Vector3d(p.x, p.y, 1.0)).hnormalized();
    target.keypoints[i].pt = {static_cast<float>(q.x()), static_cast<float>(q.y())};
    for (unsigned f = random() % (noise + 1); f > 0; --f) {
      target.descriptors.at<std::uint8_t>(static_cast<int>(i), static_cast<int>(random() % 32)) ^=
          static_cast<std::uint8_t>(1U << random() % 8);
    }
  }
  return target;
}

void run(Input& in) {
  const MatcherOptions options = matcherOptions(in);
  const Features reference = features(in, 150);
  const Features target = in.ConsumeBool() ? moved(in, reference) : features(in, 150);
  std::optional<Eigen::Matrix3d> initial;
  if (in.ConsumeBool()) {
    initial = Eigen::Matrix3d::Identity();
    for (int i = 0; i < 9; ++i)
      (*initial)(i / 3, i % 3) += in.ConsumeFloatingPointInRange(-1.0, 1.0);
  }
  KtgpMatcher matcher(options);
  MatchResult result, again;
  matcher.match(reference, target, initial, result);
  requireSound(result, reference, target, options);
  matcher.match(reference, target, initial, again);
  requireEqual(result, again, "the same answer twice");
  test::forEachInstructionSet([&] {
    KtgpMatcher(options).match(reference, target, initial, again);
    requireEqual(result, again, "the same answer with every instruction set");
  });
}

}  // namespace
}  // namespace ktgp_orb::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  ktgp_orb::fuzz::Input in(bytes, size);
  try {
    ktgp_orb::fuzz::run(in);
  } catch (const std::invalid_argument&) {
  }
  return 0;
}
