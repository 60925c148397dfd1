#pragma once

#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

#include "ktgp_orb/gms_filter.h"

namespace ktgp_orb::test {

/// Input of GmsFilter: two frames and their matches.
struct Problem {
  Features reference, target;
  std::vector<Correspondence> matches;

  void add(float reference_x, float reference_y, float target_x, float target_y) {
    const auto n = static_cast<std::int32_t>(matches.size());
    reference.keypoints.emplace_back(reference_x, reference_y, 31.0F);
    target.keypoints.emplace_back(target_x, target_y, 31.0F);
    matches.push_back({n, n, 10, 20, Level::kt});
  }
};

/// Modes in the order of the oracle's columns.
inline GmsOptions mode(int m) {
  GmsOptions options;
  options.rotation = m == 1 || m == 3;
  options.scale = m >= 2;
  return options;
}

inline std::vector<std::uint8_t> maskOf(const std::vector<Correspondence>& matches) {
  std::vector<std::uint8_t> mask;
  mask.reserve(matches.size());
  for (const Correspondence& c : matches) mask.push_back(c.level == Level::ktg ? 1 : 0);
  return mask;
}

/// Creates critical problems: empty ones, images of one pixel, motions, noise, many matches in one
/// cell, and keypoints on the lines between cells and beyond borders.
class ProblemMaker {
 public:
  explicit ProblemMaker(unsigned seed) : random_(seed) {}

  int between(int low, int high) { return std::uniform_int_distribution<int>(low, high)(random_); }
  double real(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }

  GmsOptions options(int largest_grid) {
    GmsOptions options = mode(between(0, 3));
    options.grid_columns = between(1, largest_grid);
    options.grid_rows = between(1, largest_grid);
    const std::array<double, 6> thresholds{0.0, 0.5, 1.0, 2.5, 6.0, real(0.0, 4.0)};
    options.threshold = thresholds[static_cast<std::size_t>(between(0, 5))];
    return options;
  }

  Problem problem(int largest_size, const GmsOptions& options) {
    Problem problem;
    problem.reference.image_size = size();
    problem.target.image_size = size();
    const int kind = between(0, 4);
    const double inliers = kind == 0 ? 0.0 : real(0.3, 1.0);
    const double angle = 0.25 * M_PI * between(0, 7) + real(-0.1, 0.1);
    const double zoom = std::pow(2.0, 0.5 * between(-2, 2)) * real(0.95, 1.05);
    const double spread = kind == 2 ? 0.02 : 0.6;  // 2: a crowd in one or two cells
    for (int n = between(0, largest_size); n > 0; --n) {
      // In units of the image, from its centre.
      const double x = real(-spread, spread);
      const double y = real(-spread, spread);
      double u = real(-0.6, 0.6);
      double v = real(-0.6, 0.6);
      if (kind == 4) u = 0.1 * v;  // the noise crowds a few target cells
      if (real(0.0, 1.0) < inliers) {
        u = zoom * (std::cos(angle) * x - std::sin(angle) * y);
        v = zoom * (std::sin(angle) * x + std::cos(angle) * y);
      }
      const bool on_lines = kind == 3;
      problem.add(pixel(x, problem.reference.image_size.width, options.grid_columns, on_lines),
                  pixel(y, problem.reference.image_size.height, options.grid_rows, on_lines),
                  pixel(u, problem.target.image_size.width, options.grid_columns, on_lines),
                  pixel(v, problem.target.image_size.height, options.grid_rows, on_lines));
    }
    return problem;
  }

 private:
  cv::Size size() {
    const int largest = between(0, 3) == 0 ? 3 : 2000;
    return {between(1, largest), between(1, largest)};
  }

  /// Pixel coordinate; with `on_lines` often exactly on a line of the grid or of its shifted copy.
  float pixel(double from_centre, int length, int cells, bool on_lines) {
    double position = (from_centre + 0.5) * length;
    if (on_lines && between(0, 1) == 0) {
      position = std::round(position / length * cells * 2.0) / (2.0 * cells) * length;
    }
    return static_cast<float>(position);
  }

  std::mt19937 random_;
};

}  // namespace ktgp_orb::test
