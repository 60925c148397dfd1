#pragma once

namespace ktgp_orb::util {

constexpr double kPi = 3.14159265358979323846;

}  // namespace ktgp_orb::util
