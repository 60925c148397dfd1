#pragma once

namespace ktgp_orb::util {

constexpr double kPi = 3.14159265358979323846;

/// Standard deviation of the readout time of a shutter that is not known, s; most cameras need less
/// than 30 ms, and it may be a global one.
constexpr double kUnknownReadout = 0.01;

}  // namespace ktgp_orb::util
