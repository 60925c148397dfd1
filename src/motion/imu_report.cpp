#include <algorithm>
#include <cmath>
#include <string>

#include "core/util/constants.h"
#include "core/util/format.h"
#include "ktgp_orb/ground_motion.h"

namespace ktgp_orb {
namespace {

constexpr double kDegrees = 180.0 / util::kPi;  // per rad
constexpr double kMilliseconds = 1e3;           // per s

/// As many digits as the deviation tells.
std::string plusMinus(double value, double deviation, const std::string& unit) {
  const double places = -std::floor(std::log10(std::max(deviation, 1e-6)));
  const int digits = static_cast<int>(std::max(places, 0.0));
  return util::format("%.*f +- %.*f %s", digits, value, digits, deviation, unit.c_str());
}

/// The axes that are shown, e.g. "1.0 +- 0.1 degrees off about x".
template <typename Show>
std::string axes(const Eigen::Vector3d& values, const Eigen::Vector3d& deviations,
                 const std::string& unit, const Show& is_shown) {
  std::string text;
  for (int i = 0; i < 3; ++i) {
    if (!is_shown(values(i), deviations(i))) continue;
    text += text.empty() ? "" : ", ";
    text +=
        plusMinus(kDegrees * values(i), kDegrees * deviations(i), unit) + " off about " + "xyz"[i];
  }
  return text;
}

std::string lateness(double delay, double deviation) {
  return plusMinus(kMilliseconds * std::abs(delay), kMilliseconds * deviation,
                   delay < 0.0 ? "ms early" : "ms late");
}

void append(const char* what, const std::string& more, std::string& text) {
  if (!more.empty()) text += (text.empty() ? what : std::string("; ") + what) + more;
}

/// More than noise, and more than `least`.
auto matters(double least) {
  return [least](double value, double deviation) {
    constexpr double kCertain = 4.0;  // deviations
    return std::abs(value) > least && std::abs(value) > kCertain * deviation;
  };
}

}  // namespace

std::string describe(const ImuMounting& imu) {
  const auto is_known = [](double, double deviation) { return std::isfinite(deviation); };
  std::string text;
  append("mounted ", axes(imu.rotation, imu.rotation_deviation, "degrees", is_known), text);
  if (is_known(imu.delay, imu.delay_deviation))
    append("stamps ", lateness(imu.delay, imu.delay_deviation), text);
  append("angular velocity ", axes(imu.bias, imu.bias_deviation, "degrees/s", is_known), text);
  return text;
}

std::string troubleOf(const ImuMounting& imu) {
  const auto turns_too_far = matters(0.5 / kDegrees);  // rad
  const auto is_too_late = matters(0.004);             // s
  const auto drifts = matters(0.5 / kDegrees);         // rad/s
  std::string text;
  append("the Imu seems to be mounted ",
         axes(imu.rotation, imu.rotation_deviation, "degrees", turns_too_far), text);
  if (is_too_late(imu.delay, imu.delay_deviation))
    append("the Imu's stamps seem ", lateness(imu.delay, imu.delay_deviation), text);
  append("the Imu's angular velocity seems ",
         axes(imu.bias, imu.bias_deviation, "degrees/s", drifts), text);
  return text;
}

}  // namespace ktgp_orb
