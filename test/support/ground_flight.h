#pragma once

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <cstdint>
#include <random>

#include "ktgp_orb/ground_motion.h"
#include "motion/rows.h"
#include "synthetic_pairs.h"

namespace ktgp_orb::test {

constexpr double kRate = 30.0;  // frames/s
constexpr double kDegree = 3.14159265358979323846 / 180.0;

inline std::int64_t stampOf(int frame) {
  return std::llround(1e9 * (1000.0 + frame / kRate));
}

inline Eigen::Matrix3d camera() {
  return cameraMatrix(525.0, 525.0);
}

/// Looks straight down where the base is level.
inline Pose3 downward() {
  Pose3 pose = Pose3::Identity();
  pose.linear() = Eigen::Vector3d(1.0, -1.0, -1.0).asDiagonal();
  return pose;
}

/// Looks forward and down from the front of a vehicle.
inline Pose3 mounted() {
  Pose3 pose = downward();
  pose.rotate(Eigen::AngleAxisd(0.3, Eigen::Vector3d(0.5, 0.8, 0.2).normalized()));
  pose.translation() << 0.4, -0.1, -0.2;
  return pose;
}

/// Pose of the camera, when the base is there with that yaw, pitch and roll.
inline motion::CameraPose cameraAt(const Eigen::Vector3d& position, const Eigen::Vector3d& angles,
                                   const Pose3& camera_to_base) {
  const Eigen::Matrix3d base = (Eigen::AngleAxisd(angles(0), Eigen::Vector3d::UnitZ()) *
                                Eigen::AngleAxisd(angles(1), Eigen::Vector3d::UnitY()) *
                                Eigen::AngleAxisd(angles(2), Eigen::Vector3d::UnitX()))
                                   .toRotationMatrix();
  return {base * camera_to_base.linear(), position + base * camera_to_base.translation()};
}

inline GroundMotionOptions optionsWith(const Pose3& camera_to_base) {
  GroundMotionOptions options;
  options.camera_to_base = camera_to_base;
  return options;
}

/// Homographies from keyframes over flat ground. The noise of each image is a homography near the
/// identity.
class GroundPictures {
 public:
  GroundPictures(double image_noise, unsigned seed) : image_noise(image_noise), random_(seed) {}

  double image_noise;            // noise of the entries of a homography at focal length 1
  double perspective = 1.0;      // factor of the noise of h20 and h21
  double claimed = 1.0;          // covariance of the homographies, as a multiple of the true one
  double plane_deviation = 0.0;  // px
  double lasting = 0.0;          // correlation of the noise of successive images
  int keyframe_every = 10;

  GroundFrame seenFrom(const motion::CameraPose& pose) {
    const int frame = frame_++;
    GroundFrame result;
    result.stamp = stampOf(frame);
    result.camera = camera();
    Eigen::Matrix3d noise = Eigen::Matrix3d::Identity();
    const double fresh = frame == 0 ? 1.0 : std::sqrt(1.0 - lasting * lasting);
    for (int i = 0; i < 8; ++i) {
      const double added = image_noise * (i < 6 ? 1.0 : perspective) * normal();
      errors_(i) = lasting * errors_(i) + fresh * added;
      noise(i / 3, i % 3) += errors_(i);
    }
    const Eigen::Matrix3d image = noise * motion::imageFromGround(pose);
    if (frame > 0) {
      result.reference_stamp = stampOf(keyframe_);
      const Eigen::Matrix3d h = camera() * image * keyframe_image_.inverse() * camera().inverse();
      const Eigen::Matrix3d normalised = h / h(2, 2);
      const double differs = 1.0 - std::pow(lasting, frame - keyframe_);
      result.answer = UncertainHomography{normalised, claimed * differs * covarianceOf(normalised),
                                          Covariance8::Zero(), plane_deviation};
    }
    if (frame % keyframe_every == 0) {
      keyframe_ = frame;
      keyframe_image_ = image;
    }
    return result;
  }

  double normal() { return normal_(random_); }
  Eigen::Vector3d shake() { return {normal(), normal(), normal()}; }

 private:
  /// Covariance from the noise of both images, by numeric derivatives.
  Covariance8 covarianceOf(const Eigen::Matrix3d& h) const {
    Eigen::Matrix<double, 8, 16> slope;
    for (int i = 0; i < 16; ++i) {
      Eigen::Matrix3d change = Eigen::Matrix3d::Zero();
      change((i % 8) / 3, (i % 8) % 3) = 1e-7;
      change = camera() * change * camera().inverse();
      const Eigen::Matrix3d moved =
          i < 8 ? Eigen::Matrix3d(h + change * h) : Eigen::Matrix3d(h - h * change);
      slope.col(i) = (i % 8 < 6 ? 1.0 : perspective) *
                     (motion::entriesOf(moved) - motion::entriesOf(h)) / 1e-7;
    }
    return image_noise * image_noise * slope * slope.transpose();
  }

  std::mt19937 random_;
  std::normal_distribution<double> normal_;
  int frame_ = 0;
  int keyframe_ = 0;
  Eigen::Matrix<double, 8, 1> errors_ = Eigen::Matrix<double, 8, 1>::Zero();
  Eigen::Matrix3d keyframe_image_ = Eigen::Matrix3d::Identity();
};

}  // namespace ktgp_orb::test
