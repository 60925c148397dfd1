// All stages with features as in a message, of two frames that may show the same scene.
#include <Eigen/Geometry>

#include "invariants.h"
#include "one_instruction_set.h"

namespace ktgp_orb::fuzz {
namespace {

using util::Random;

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
  Random random(in.ConsumeIntegral<std::uint16_t>());
  for (std::size_t i = 0; i < target.size(); ++i) {
    const cv::Point2f& p = reference.keypoints[i].pt;
    const Eigen::Vector2d q = (h * Eigen::Vector3d(p.x, p.y, 1.0)).hnormalized();
    target.keypoints[i].pt = {static_cast<float>(q.x()), static_cast<float>(q.y())};
    flipBits(target.descriptors.ptr(static_cast<int>(i)), random.below(noise + 1), random);
  }
  return target;
}

MatchHints matchHints(Input& in) {
  MatchHints hints;
  if (in.ConsumeBool()) hints.prediction = homography(in, 50.0);
  hints.whole_image = in.ConsumeIntegralInRange(0, 7) == 0;
  return hints;
}

void run(Input& in) {
  const MatcherOptions options = matcherOptions(in);
  Features reference = features(in, 250);
  if (in.ConsumeIntegralInRange(0, 7) == 0) {
    reference.image_size = {in.ConsumeIntegralInRange(24, 150), in.ConsumeIntegralInRange(24, 150)};
    reference.images = pyramid(in, reference.image_size);
  }
  const Features target = in.ConsumeIntegralInRange(0, 3) != 0 ? moved(in, reference)  //
                                                               : features(in, 250);
  MatchHints hints = matchHints(in);
  // Reused: the result must not depend on old content.
  static MatchResult result, again;
  KtgpMatcher matcher(options);
  matcher.match(reference, target, hints, result);
  requireSound(result, reference, target, options);
  if (in.ConsumeIntegralInRange(0, 3) == 0) {
    matcher.match(reference, target, hints, again);
    requireEqual(result, again, "the same answer twice");
  } else {
    const OneInstructionSet one(in);
    KtgpMatcher(options).match(reference, target, hints, again);
    requireEqual(result, again, "the same answer with every instruction set");
  }
}

}  // namespace
}  // namespace ktgp_orb::fuzz

KTGP_ORB_FUZZ(ktgp_orb::fuzz::run)
