#pragma once

namespace ktgp_orb::util {

constexpr double kPi = 3.14159265358979323846;

/// Standard deviation, s, that we assume for the readout time of an unknown shutter. Most cameras
/// read an image out in less than 30 ms, and a global shutter has a readout time of 0.
constexpr double kUnknownReadout = 0.01;

}  // namespace ktgp_orb::util
