#pragma once

#include <sstream>
#include <stdexcept>
#include <string>

namespace ktgp_orb::util {

/// Throws std::invalid_argument "<name> is <value>; expected a value in [low, high]" unless
/// low <= value <= high (NaN is refused).
template <typename T>
void requireInRange(const std::string& name, T value, T low, T high) {
  if (value >= low && value <= high) return;
  std::ostringstream message;
  message << name << " is " << value << "; expected a value in [" << low << ", " << high << "]";
  throw std::invalid_argument(message.str());
}

}  // namespace ktgp_orb::util
