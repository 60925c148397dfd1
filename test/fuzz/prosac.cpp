// The estimator with pairs of points of all kinds: random, on a line, duplicated, related, huge,
// not finite.
#include <Eigen/LU>
#include <optional>

#include "invariants.h"

namespace ktgp_orb::fuzz {
namespace {

using util::Random;

PointPairs pointPairs(Input& in) {
  PointPairs pairs;
  const int count = few(in, 200);
  const int kind = in.ConsumeIntegralInRange(0, 4);
  const double noise = in.ConsumeFloatingPointInRange(0.0, 8.0);
  const unsigned outliers = in.ConsumeIntegralInRange(0U, 100U);
  const Eigen::Matrix3d h = homography(in, 100.0, 0.5);
  Random random(in.ConsumeIntegral<std::uint16_t>());
  const auto uniform = [&](double size) {
    return size * static_cast<double>(random.below(65536)) / 65536.0;
  };
  for (int i = 0; i < count; ++i) {
    Eigen::Vector2d x(uniform(640.0), uniform(480.0));
    if (kind == 1) x.y() = 0.3 * x.x() + 5.0;                              // on a line
    if (kind == 2) x = Eigen::Vector2d(random.below(3), random.below(3));  // doubled
    if (kind == 3) x = {anyDouble(in, -1e4, 1e4), anyDouble(in, -1e4, 1e4)};
    Eigen::Vector2d y = (h * x.homogeneous()).hnormalized();
    y += Eigen::Vector2d(uniform(noise), uniform(noise));
    if (random.below(100) < outliers) y = {uniform(640.0), uniform(480.0)};
    if (kind == 4 && i % 2 == 1) y = pairs.target.back();  // many to one
    pairs.add(x, y, uniform(1.0));
  }
  return pairs;
}

void run(Input& in) {
  ProsacOptions options = matcherOptions(in).prosac;
  options.confidence = in.ConsumeFloatingPointInRange(0.01, 0.9999);
  const cv::Size size = in.ConsumeBool() ? cv::Size(640, 480) : cv::Size();
  const PointPairs pairs = pointPairs(in);
  std::optional<Eigen::Matrix3d> initial;
  if (in.ConsumeBool()) initial = homography(in, 1.0, 1.0, 1.0);
  ProsacHomography prosac(options);
  // Reused: the result must not depend on old content.
  static ProsacResult result, again;
  prosac.estimate(pairs, size, initial, result);
  requireSound(result, pairs, options.max_error);
  prosac.estimate(pairs, size, initial, again);
  require(result.status == again.status && result.answer.homography == again.answer.homography &&
              result.mask == again.mask,
          "the same answer twice");
}

}  // namespace
}  // namespace ktgp_orb::fuzz

KTGP_ORB_FUZZ(ktgp_orb::fuzz::run)  // values that are not finite
