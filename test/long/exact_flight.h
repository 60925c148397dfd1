#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <cstdint>
#include <opencv2/core.hpp>
#include <random>

#include "demo/flight.h"
#include "demo/map.h"
#include "motion/camera_pose.h"

namespace ktgp_orb::test {

/// A flight over the drawn map with random height, speed, yaw and tilt: exact at every time. The
/// height is 600 px of the map in the middle, so pictures have details at every height.
class ExactFlight {
 public:
  explicit ExactFlight(std::uint64_t seed) {
    std::mt19937_64 random(seed);
    const auto between = [&random](double low, double high) {
      return low + (high - low) * static_cast<double>(random() >> 11) * 0x1.0p-53;
    };
    height_ = std::pow(30.0, between(0.0, 1.0));                            // m, 1 to 30
    const double speed = between(0.3, 1.0) * std::min(8.0, 3.0 * height_);  // m/s, the highest
    metre_ = height_ / 600.0;
    const double turn = speed / (metre_ * std::hypot(900.0, 770.0));
    along_ = {turn, between(0.0, 6.28)};
    across_ = {1.1 * turn, between(0.0, 6.28)};
    rise_ = {between(0.3, 0.9), between(0.0, 6.28)};
    yaw_ = {between(0.4, 1.0), between(0.0, 6.28)};
    yaw_size_ = between(10.0, 60.0) / yaw_.rate * kDegree;
    pitch_ = {between(0.5, 1.2), between(0.0, 6.28)};
    roll_ = {between(0.5, 1.2), between(0.0, 6.28)};
    tilt_ = between(5.0, 25.0) / std::sqrt(2.0) * kDegree;
  }

  double height() const { return height_; }

  /// Ground: the map's plane, metres, z up.
  motion::CameraPose pose(double t) const {
    using Eigen::AngleAxisd;
    using Eigen::Vector3d;
    motion::CameraPose pose;
    pose.axes = AngleAxisd(yaw_size_ * yaw_.at(t), Vector3d::UnitZ()).toRotationMatrix() *
                Vector3d(1.0, -1.0, -1.0).asDiagonal() *
                AngleAxisd(tilt_ * pitch_.at(t), Vector3d::UnitX()).toRotationMatrix() *
                AngleAxisd(tilt_ * roll_.at(t), Vector3d::UnitY()).toRotationMatrix();
    pose.position << 900.0 * metre_ * along_.at(t), 700.0 * metre_ * across_.at(t),
        height_ * (1.0 + 0.2 * rise_.at(t));
    return pose;
  }

  Eigen::Matrix3d imageFromMap(double t) const {
    Eigen::Matrix3d ground_from_map;
    const double middle = 0.5 * demo::kMapSize * metre_;
    ground_from_map << metre_, 0, -middle, 0, -metre_, middle, 0, 0, 1;
    return camera() * motion::imageFromGround(pose(t)) * ground_from_map;
  }

  static Eigen::Matrix3d camera() {
    Eigen::Matrix3d k;
    k << demo::kFocalLength, 0, 0.5 * (demo::kImageWidth - 1), 0, demo::kFocalLength,
        0.5 * (demo::kImageHeight - 1), 0, 0, 1;
    return k;
  }

 private:
  static constexpr double kDegree = 3.14159265358979323846 / 180.0;
  struct Wave {
    double rate = 0.0;
    double phase = 0.0;
    double at(double t) const { return std::sin(rate * t + phase); }
  };

  double height_, metre_, yaw_size_, tilt_;
  Wave along_, across_, rise_, yaw_, pitch_, roll_;
};

}  // namespace ktgp_orb::test
