#include "core/orb/vector_angle.h"

#include <algorithm>
#include <cfloat>
#include <cmath>

#include "core/util/constants.h"

namespace ktgp_orb {
namespace {

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

}  // namespace

float vectorAngle(float y, float x) {
  const float width = std::abs(x);
  const float height = std::abs(y);
  const bool is_flat = width >= height;
  // The addend keeps the null vector from dividing by zero and changes no other.
  const float ratio =
      std::min(width, height) / (std::max(width, height) + static_cast<float>(DBL_EPSILON));
  float angle = is_flat ? arcTangent(ratio) : 90.f - arcTangent(ratio);
  if (x < 0) angle = 180.f - angle;
  if (y < 0) angle = 360.f - angle;
  return angle;
}

}  // namespace ktgp_orb
