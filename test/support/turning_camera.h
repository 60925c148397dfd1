#pragma once

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "orb_test_images.h"
#include "synthetic_pairs.h"

namespace ktgp_orb::test {

/// A camera in the middle of a drawn sphere around it, of 320x240 px.
struct TurningCamera {
  cv::Size size{320, 240};
  Eigen::Matrix3d camera = cameraMatrix(280.0, 280.0, 159.5, 119.5);  // 60 degrees wide
  /// The distance of the sphere is from 1 - relief to 1 + relief.
  double relief = 0.0;

  /// Homography of the pixels before -> after a turn.
  Eigen::Matrix3d homography(const Eigen::Matrix3d& turn) const {
    return camera * turn * camera.inverse();
  }

  /// `turn`: world -> camera; `position`: of the camera in the world.
  cv::Mat view(const Eigen::Matrix3d& turn,
               const Eigen::Vector3d& position = Eigen::Vector3d::Zero()) const {
    constexpr double kPixels = 340.0;  // per radian: more than the camera resolves
    static const cv::Mat sphere =
        textureImage({static_cast<int>(2.0 * M_PI * kPixels), static_cast<int>(M_PI * kPixels)}, 7);
    const Eigen::Matrix3d to_world = turn.transpose() * camera.inverse();
    cv::Mat pixels(size, CV_32FC2);
    for (int y = 0; y < size.height; ++y) {
      for (int x = 0; x < size.width; ++x) {
        const Eigen::Vector3d p =
            seen(position, (to_world * Eigen::Vector3d(x, y, 1.0)).normalized());
        pixels.at<cv::Vec2f>(y, x) = {
            static_cast<float>(kPixels * (M_PI + std::atan2(p.x(), p.z()))),
            static_cast<float>(kPixels * (0.5 * M_PI + std::asin(p.y() / p.norm())))};
      }
    }
    cv::Mat image;
    cv::remap(sphere, image, pixels, cv::noArray(), cv::INTER_LINEAR, cv::BORDER_REPLICATE);
    return image;
  }

 private:
  /// The point of the world on a ray.
  Eigen::Vector3d seen(const Eigen::Vector3d& position, const Eigen::Vector3d& ray) const {
    Eigen::Vector3d point = ray;
    if (position.isZero()) return point;
    for (int i = 0; i < 10; ++i) {
      const double along = std::atan2(point.x(), point.z());
      const double distance =
          1.0 + relief * std::sin(8.0 * along) * std::cos(6.0 * point.y() / point.norm());
      const double back = position.dot(ray);
      point = position +
              ray * (std::sqrt(back * back - position.squaredNorm() + distance * distance) - back);
    }
    return point;
  }
};

}  // namespace ktgp_orb::test
