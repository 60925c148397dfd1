#pragma once

namespace ktgp_orb::util {

constexpr double kPi = 3.14159265358979323846;

/// Standard deviation of the readout time of an unknown shutter, s. Most cameras read an image out
/// in less than 30 ms, and a global shutter needs no time.
constexpr double kUnknownReadout = 0.01;

}  // namespace ktgp_orb::util
