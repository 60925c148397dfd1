#pragma once

#include <Eigen/Core>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "synthetic_pairs.h"

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

inline const cv::Size kFlightSize(640, 480);

/// Largest distance that the picture shows beyond the border of the frame, px; negative: it stays
/// inside.
inline double beyondBorder(const Eigen::Matrix3d& warp) {
  double worst = -1e9;
  for (const Eigen::Vector2d& p : corners(kFlightSize)) {
    const Eigen::Vector2d q = (warp.inverse() * p.homogeneous()).hnormalized();
    worst = std::max({worst, -q.x(), -q.y(), q.x() - 639.0, q.y() - 479.0});
  }
  return worst;
}

}  // namespace ktgp_orb::test
