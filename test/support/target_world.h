#pragma once

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "evaluation/rendering.h"
#include "ktgp_orb/target_finder.h"
#include "orb_test_images.h"
#include "synthetic_pairs.h"

namespace ktgp_orb::test {

inline Target targetOf(const std::string& id, const cv::Mat& image) {
  Target target;
  target.id = id;
  target.images = {image};
  return target;
}

/// A drawn one, number `seed`.
inline Target poster(const cv::Size& size, int seed) {
  return targetOf("poster" + std::to_string(seed),
                  drawnPicture(size, static_cast<std::uint64_t>(seed)));
}

/// Where a target is in the view of a camera.
struct Placement {
  double tilt = 0.0;  ///< tilt of the plane, rad
  double zoom = 1.0;  ///< px of the frame per px of the target, in its middle
  double turn = 0.0;  ///< in the image, rad
  double axis = 0.0;  ///< axis of the tilt, rad
  Eigen::Vector2d middle = Eigen::Vector2d(320.0, 240.0);  ///< px
};

/// Target -> frame, px, for a camera with a focal length of 600 px.
inline Eigen::Matrix3d homographyOf(const Placement& p, const cv::Size& target) {
  constexpr double kFocal = 600.0;
  const Eigen::Matrix3d camera = cameraMatrix(kFocal, kFocal);
  const Eigen::Matrix3d rotation =
      (Eigen::AngleAxisd(p.tilt, Eigen::Vector3d(std::cos(p.axis), std::sin(p.axis), 0.0)) *
       Eigen::AngleAxisd(p.turn, Eigen::Vector3d::UnitZ()))
          .toRotationMatrix();
  const double depth = kFocal / p.zoom;
  Eigen::Matrix3d pose;
  pose << rotation.col(0), rotation.col(1),
      depth * (camera.inverse() * p.middle.homogeneous()).eval();
  const Eigen::Matrix3d h =
      camera * pose * translation(-0.5 * (target.width - 1), -0.5 * (target.height - 1));
  return h / h(2, 2);
}

/// Draws the target into the frame (CV_32F), antialiased.
inline void place(const cv::Mat& target, const Eigen::Matrix3d& homography, cv::Mat& frame) {
  cv::Mat source, ones(target.size(), CV_32F, cv::Scalar(1.0));
  target.convertTo(source, CV_32F);
  const Eigen::Matrix3d back = homography.inverse();
  const cv::Mat view = evaluation::renderView(source, back, frame.size());
  const cv::Mat share = evaluation::renderView(ones, back, frame.size());
  frame = frame.mul(1.0 - share) + view;
}

/// A target in front of a background.
inline cv::Mat inFrontOf(const cv::Mat& background, const cv::Mat& target,
                         const Eigen::Matrix3d& homography) {
  cv::Mat frame, image;
  background.convertTo(frame, CV_32F);
  place(target, homography, frame);
  frame.convertTo(image, CV_8U);
  return image;
}

/// The poster of that number in a frame.
struct Shown {
  int number;
  Eigen::Matrix3d homography;  ///< poster -> frame, px
};

/// Posters of one size in front of a drawn background.
inline cv::Mat frameOf(const std::vector<Shown>& all, const cv::Size& poster_size,
                       const cv::Size& size, std::uint64_t background) {
  cv::Mat frame, image;
  drawnPicture(size, background).convertTo(frame, CV_32F);
  for (const Shown& one : all) {
    place(poster(poster_size, one.number).images[0], one.homography, frame);
  }
  frame.convertTo(image, CV_8U);
  return image;
}

/// Errors of found corners beside their covariances.
struct CornerErrors {
  double squares = 0.0, largest = 0.0;  ///< px
  Normalised normalised;

  double rms() const { return std::sqrt(squares / static_cast<double>(normalised.count())); }
  void add(const DetectedTarget& found, const Eigen::Matrix3d& truth, const cv::Size& target) {
    std::size_t i = 0;
    for (const Eigen::Vector2d& corner : corners(target)) {
      const Eigen::Vector2d error = found.corners[i] - apply(truth, corner);
      squares += error.squaredNorm();
      largest = std::max(largest, error.norm());
      normalised.add(error, found.corner_covariances[i++]);
    }
  }
};

/// Largest distance between the positions that both homographies give for the parts of the target
/// that are in the frame, px.
inline double errorInView(const Eigen::Matrix3d& truth, const Eigen::Matrix3d& found,
                          const cv::Size& target, const cv::Size& frame) {
  double largest = 0.0;
  for (int y = 0; y <= 8; ++y) {
    for (int x = 0; x <= 8; ++x) {
      const Eigen::Vector2d p(x * (target.width - 1) / 8.0, y * (target.height - 1) / 8.0);
      const Eigen::Vector2d there = apply(truth, p);
      if (isInside(there, frame)) largest = std::max(largest, (there - apply(found, p)).norm());
    }
  }
  return largest;
}

}  // namespace ktgp_orb::test
