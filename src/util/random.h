#pragma once

#include <cstdint>

namespace ktgp_orb::util {

/// Random numbers from SplitMix64 (Steele, Lea & Flood, OOPSLA 2014). Its state has 64 bits, and it
/// gives the same numbers on all machines.
class Random {
 public:
  explicit Random(std::uint64_t seed) : state_(seed) {}

  std::uint64_t next() {
    state_ += 0x9e3779b97f4a7c15U;
    std::uint64_t z = state_;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9U;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebU;
    return z ^ (z >> 31);
  }

  /// A random number in [0, n). All numbers are equally likely except for a bias of n / 2^32, which
  /// is too small to matter.
  std::uint32_t below(std::uint32_t n) {
    return static_cast<std::uint32_t>(((next() >> 32) * n) >> 32);
  }

 private:
  std::uint64_t state_;
};

}  // namespace ktgp_orb::util
