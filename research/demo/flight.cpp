#include "demo/flight.h"

#include <Eigen/Geometry>
#include <cmath>
#include <opencv2/core/eigen.hpp>
#include <opencv2/imgproc.hpp>

#include "demo/map.h"
#include "util/constants.h"

namespace ktgp_orb::demo {
namespace {

constexpr double kDegree = util::kPi / 180.0;

/// Point of the map below the camera, px: a long loop around the middle of the map.
Eigen::Vector2d groundTrack(double t) {
  const double turn = 0.42 * t;
  return {0.5 * kMapSize + 900.0 * std::cos(turn) + 60.0 * std::sin(1.3 * t),
          0.5 * kMapSize + 700.0 * std::sin(turn) + 40.0 * std::sin(1.7 * t)};
}

/// Shake of a hand: root mean square 1, different for each axis.
double tremble(double t, int axis) {
  constexpr double kFrequencies[] = {3.1, 5.3, 7.9, 11.7};  // 1/s
  double sum = 0.0;
  for (const double frequency : kFrequencies) {
    sum += std::sin(2.0 * util::kPi * (frequency + 0.37 * axis) * t + 1.7 * frequency * (axis + 1));
  }
  return sum / std::sqrt(0.5 * 4.0);
}

/// Pose in px of the map, whose z axis points down.
motion::CameraPose mapPose(double t, const Manner& manner) {
  const double height = 600.0 + 130.0 * std::sin(0.9 * t);  // px of the map
  const double yaw = (25.0 * std::sin(0.55 * t) + 6.0 * t) * kDegree;
  const double pitch = manner.tilt * std::sin(0.8 * t + 1.0) * kDegree;
  const double roll = 0.8 * manner.tilt * std::sin(1.1 * t) * kDegree;
  const double angle = manner.shake / kFocalLength;  // rad; it shifts the image by `shake` px
  motion::CameraPose pose;
  pose.axes = (Eigen::AngleAxisd(pitch + angle * tremble(t, 0), Eigen::Vector3d::UnitX()) *
               Eigen::AngleAxisd(roll + angle * tremble(t, 1), Eigen::Vector3d::UnitY()) *
               Eigen::AngleAxisd(yaw + angle * tremble(t, 2), Eigen::Vector3d::UnitZ()))
                  .toRotationMatrix()
                  .transpose();
  // The camera looks along +z onto the plane z = 0 from z = -height.
  pose.position << groundTrack(t), -height;
  return pose;
}

}  // namespace

motion::CameraPose poseAt(double seconds, const Manner& manner) {
  const motion::CameraPose pose = mapPose(seconds, manner);
  const Eigen::Vector3d mirror(1.0, -1.0, -1.0);  // half a turn about x
  const Eigen::Vector3d middle(0.5 * kMapSize, 0.5 * kMapSize, 0.0);
  return {mirror.asDiagonal() * pose.axes, kMetre * mirror.asDiagonal() * (pose.position - middle)};
}

Eigen::Matrix3d intrinsics() {
  Eigen::Matrix3d k;
  k << kFocalLength, 0, 0.5 * (kImageWidth - 1), 0, kFocalLength, 0.5 * (kImageHeight - 1), 0, 0, 1;
  return k;
}

Eigen::Matrix3d imageFromMap(double seconds, const Manner& manner) {
  const motion::CameraPose pose = mapPose(seconds, manner);
  const Eigen::Matrix3d rotation = pose.axes.transpose();
  Eigen::Matrix3d plane;  // the plane's x and y axes and origin in the camera's frame
  plane << rotation.col(0), rotation.col(1), -rotation * pose.position;
  return intrinsics() * plane;
}

cv::Mat render(const cv::Mat& map, const Eigen::Matrix3d& image_from_map) {
  constexpr double kOversampling = 2.0;
  Eigen::Matrix3d oversampled;  // pixel centres: x -> 2 x + 1/2
  const double shift = 0.5 * (kOversampling - 1.0);
  oversampled << kOversampling, 0, shift, 0, kOversampling, shift, 0, 0, 1;
  cv::Mat homography;
  cv::eigen2cv(Eigen::Matrix3d(oversampled * image_from_map), homography);
  const cv::Size size(kImageWidth, kImageHeight);
  cv::Mat large;
  cv::Mat image;
  cv::warpPerspective(map, large, homography, size * static_cast<int>(kOversampling),
                      cv::INTER_LINEAR, cv::BORDER_REFLECT_101);
  cv::resize(large, image, size, 0, 0, cv::INTER_AREA);
  return image;
}

}  // namespace ktgp_orb::demo
