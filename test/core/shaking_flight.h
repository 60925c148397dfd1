#pragma once

#include <Eigen/Core>
#include <cmath>
#include <random>
#include <vector>

namespace ktgp_orb::test {

using Path = std::vector<Eigen::Matrix3d>;  ///< world -> frame

/// A camera that pans, turns and sways slowly, with `shake` px of random jitter on top.
inline Path shakingFlight(int frames, double shake, double pan = 4.0, unsigned seed = 1) {
  std::mt19937 random(seed);
  std::normal_distribution<double> jitter(0.0, 1.0);
  Path path;
  for (int i = 0; i < frames; ++i) {
    const double t = i / 30.0;
    const double angle = 0.1 * std::sin(0.8 * t) + shake * 0.002 * jitter(random);
    Eigen::Matrix3d h;
    h << std::cos(angle), -std::sin(angle), pan * i + shake * jitter(random), std::sin(angle),
        std::cos(angle), 30.0 * std::sin(1.1 * t) + shake * jitter(random), 0.0, 1e-5 * std::sin(t),
        1.0;
    path.push_back(h);
  }
  return path;
}

}  // namespace ktgp_orb::test
