#pragma once

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "evaluation/rendering.h"
#include "synthetic_pairs.h"

namespace ktgp_orb::test {

/// A poster: shapes, lines and words in random places. Equal for equal seeds.
inline cv::Mat drawnPicture(const cv::Size& size, std::uint64_t seed) {
  cv::RNG rng(seed * 0x9e3779b97f4a7c15U + 1);
  cv::Mat image(size, CV_8U, cv::Scalar(rng.uniform(60, 220)));
  const auto place = [&] {
    return cv::Point(rng.uniform(0, size.width), rng.uniform(0, size.height));
  };
  const auto grey = [&] { return cv::Scalar(rng.uniform(0, 256)); };
  for (int i = 0; i < 14; ++i) {
    cv::rectangle(image, place(), place() / 3 + place() / 3, grey(), cv::FILLED, cv::LINE_AA);
    cv::circle(image, place(), rng.uniform(4, size.width / 10), grey(), cv::FILLED, cv::LINE_AA);
    const std::vector<cv::Point> triangle{place(), place(), place()};
    if (i % 4 == 0) cv::fillConvexPoly(image, triangle, grey(), cv::LINE_AA);
  }
  for (int i = 0; i < 40; ++i) {
    std::string word;
    for (int n = rng.uniform(2, 8); n > 0; --n)
      word += static_cast<char>(rng.uniform('0', 'z' + 1));
    cv::putText(image, word, place(), rng.uniform(0, 8), rng.uniform(0.3, 1.8), grey(),
                rng.uniform(1, 4), cv::LINE_AA);
  }
  return image;
}

/// Where a target is in the view of a camera.
struct Placement {
  double tilt = 0.0;  ///< of the plane, rad
  double zoom = 1.0;  ///< px of the frame per px of the target, in its middle
  double turn = 0.0;  ///< in the image, rad
  double axis = 0.0;  ///< of the tilt, rad
  Eigen::Vector2d middle = Eigen::Vector2d(320.0, 240.0);  ///< px
};

/// Target -> frame, px, for a camera with a focal length of 600 px.
inline Eigen::Matrix3d homographyOf(const Placement& p, const cv::Size& target) {
  constexpr double kFocal = 600.0;
  const Eigen::Matrix3d camera =
      (Eigen::Matrix3d() << kFocal, 0, 319.5, 0, kFocal, 239.5, 0, 0, 1).finished();
  const Eigen::Matrix3d rotation =
      (Eigen::AngleAxisd(p.tilt, Eigen::Vector3d(std::cos(p.axis), std::sin(p.axis), 0.0)) *
       Eigen::AngleAxisd(p.turn, Eigen::Vector3d::UnitZ()))
          .toRotationMatrix();
  const double depth = kFocal / p.zoom;
  Eigen::Matrix3d pose;
  pose << rotation.col(0), rotation.col(1),
      depth * (camera.inverse() * p.middle.homogeneous()).eval();
  Eigen::Matrix3d centred = Eigen::Matrix3d::Identity();
  centred(0, 2) = -0.5 * (target.width - 1);
  centred(1, 2) = -0.5 * (target.height - 1);
  const Eigen::Matrix3d h = camera * pose * centred;
  return h / h(2, 2);
}

/// Draws the target into the frame (CV_32F), antialiased.
inline void place(const cv::Mat& target, const Eigen::Matrix3d& homography, cv::Mat& frame) {
  cv::Mat source, ones(target.size(), CV_32F, cv::Scalar(1.0));
  target.convertTo(source, CV_32F);
  const Eigen::Matrix3d back = homography.inverse();
  const cv::Mat view = tools::renderView(source, back, frame.size());
  const cv::Mat share = tools::renderView(ones, back, frame.size());
  frame = frame.mul(1.0 - share) + view;
}

/// Largest distance between the positions that both homographies give for the parts of the target
/// that are in the frame, px.
inline double errorInView(const Eigen::Matrix3d& truth, const Eigen::Matrix3d& found,
                          const cv::Size& target, const cv::Size& frame) {
  double largest = 0.0;
  for (int y = 0; y <= 8; ++y) {
    for (int x = 0; x <= 8; ++x) {
      const Eigen::Vector3d p(x * (target.width - 1) / 8.0, y * (target.height - 1) / 8.0, 1.0);
      const Eigen::Vector2d there = (truth * p).hnormalized();
      if (!isInside(there, frame)) continue;
      largest = std::max(largest, (there - (found * p).hnormalized()).norm());
    }
  }
  return largest;
}

}  // namespace ktgp_orb::test
