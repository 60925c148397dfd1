#pragma once

#include <Eigen/Core>
#include <Eigen/LU>
#include <functional>
#include <opencv2/core.hpp>
#include <vector>

#include "frame_pair.h"

namespace ktgp_orb::test {

/// A camera above a plane whose rows are exposed one after the other, the middle one at the time of
/// the image.
struct RollingCamera {
  std::function<Eigen::Matrix3d(double)> view;  // plane -> image at a time, s
  double readout = 0.0;                         // from the first row to the last one, s; 0: global
  cv::Size size;

  Eigen::Matrix3d viewOf(double row, double seconds) const {
    return view(seconds + readout * (row - 0.5 * (size.height - 1)) / size.height);
  }

  /// Where a point of the plane is seen.
  Eigen::Vector2d seen(const Eigen::Vector2d& point, double seconds) const {
    Eigen::Vector2d pixel(0.0, 0.5 * (size.height - 1));
    for (int i = 0; i < 10; ++i) {
      pixel = (viewOf(pixel.y(), seconds) * point.homogeneous()).hnormalized();
    }
    return pixel;
  }

  cv::Mat picture(const cv::Mat& plane, double seconds) const {
    cv::Mat image(size, plane.type());
    for (int row = 0; row < size.height; ++row) {
      Eigen::Matrix3d up = Eigen::Matrix3d::Identity();
      up(1, 2) = -row;
      const Eigen::Matrix3d to_row = up * viewOf(row, seconds);
      warped(plane, to_row, {size.width, 1}, cv::INTER_LINEAR).copyTo(image.row(row));
    }
    return image;
  }

  /// Points of the plane, spread over the picture.
  std::vector<Eigen::Vector2d> points(double seconds) const {
    constexpr int kGrid = 6;
    const Eigen::Matrix3d to_plane = view(seconds).inverse();
    std::vector<Eigen::Vector2d> points;
    for (int i = 0; i < kGrid * kGrid; ++i) {
      const Eigen::Vector3d pixel((i % kGrid + 0.5) * size.width / kGrid,
                                  (i / kGrid + 0.5) * size.height / kGrid, 1.0);
      points.emplace_back((to_plane * pixel).hnormalized());
    }
    return points;
  }
};

}  // namespace ktgp_orb::test
