#include "core/orb/vector_angle.h"

#include <algorithm>
#include <cfloat>
#include <cmath>

#include "core/util/constants.h"

namespace ktgp_orb::orb {
namespace {

using util::kPi;

constexpr auto kDegrees = static_cast<float>(180 / kPi);

// Arc tangent of a ratio in [0, 1], in degrees.
float arcTangent(float ratio) {
  constexpr float kP1 = 0.9997878412794807f * kDegrees;
  constexpr float kP3 = -0.3258083974640975f * kDegrees;
  constexpr float kP5 = 0.1555786518463281f * kDegrees;
  constexpr float kP7 = -0.04432655554792128f * kDegrees;
  const float square = ratio * ratio;
  return (((kP7 * square + kP5) * square + kP3) * square + kP1) * ratio;
}

// `whole` - angle if wanted, else the angle, which is not negative. Without a branch, since the
// branch would be unpredictable.
float reflected(float angle, float whole, bool wanted) {
  const float sign[] = {1.f, -1.f};
  const float base[] = {0.f, whole};
  return base[static_cast<int>(wanted)] + sign[static_cast<int>(wanted)] * angle;
}

}  // namespace

float vectorAngle(float y, float x) {
  const float width = std::abs(x);
  const float height = std::abs(y);
  const bool is_flat = width >= height;
  // The addend avoids a division by zero for the null vector and changes no other result.
  const float ratio =
      std::min(width, height) / (std::max(width, height) + static_cast<float>(DBL_EPSILON));
  const float angle = reflected(arcTangent(ratio), 90.f, !is_flat);
  return reflected(reflected(angle, 180.f, x < 0), 360.f, y < 0);
}

}  // namespace ktgp_orb::orb
