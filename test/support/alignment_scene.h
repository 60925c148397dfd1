#pragma once

#include <Eigen/Core>
#include <Eigen/LU>
#include <cmath>
#include <cstdint>
#include <functional>
#include <opencv2/core.hpp>
#include <random>
#include <vector>

#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/features.h"
#include "ktgp_orb/orb_extractor.h"
#include "ktgp_orb/prosac_homography.h"
#include "orb_test_images.h"
#include "synthetic_pairs.h"

namespace ktgp_orb::test {

/// A picture given by a formula, so that it can be sampled anywhere without interpolation: waves of
/// 7 to 60 px in all directions.
class WavePicture {
 public:
  explicit WavePicture(unsigned seed) {
    std::mt19937 generator(seed);
    std::uniform_real_distribution<double> uniform(0.0, 1.0);
    for (Wave& wave : waves_) {
      const double length = 7.0 * std::pow(60.0 / 7.0, uniform(generator));
      const double direction = 6.283 * uniform(generator);
      wave.x = 6.283 / length * std::cos(direction);
      wave.y = 6.283 / length * std::sin(direction);
      wave.phase = 6.283 * uniform(generator);
    }
  }

  /// Grey value, about 60 to 200.
  double at(const Eigen::Vector2d& p) const {
    double sum = 0.0;
    for (const Wave& wave : waves_) sum += std::sin(wave.x * p.x() + wave.y * p.y() + wave.phase);
    return 128.0 + 14.0 * sum;
  }

 private:
  struct Wave {
    double x, y, phase;
  };
  Wave waves_[12];
};

/// The image whose pixel x has the value `grey(x)`.
inline cv::Mat render(const cv::Size& size,
                      const std::function<double(const Eigen::Vector2d&)>& grey) {
  return drawn(size, [&](double x, double y) { return grey({x, y}); });
}

/// An image with its pyramid and a grid of keypoints `spacing` px apart, `margin` px off the
/// border.
inline Features gridFeatures(const cv::Mat& image, double spacing, double margin) {
  OrbOptions options;
  options.images = ImageKeeping::share;
  OrbExtractor extractor(options);
  Features features;
  extractor.extract(image, features);
  features.keypoints.clear();
  for (double y = margin; y < image.rows - margin; y += spacing) {
    for (double x = margin; x < image.cols - margin; x += spacing) {
      features.keypoints.emplace_back(static_cast<float>(x), static_cast<float>(y), 31.F);
    }
  }
  return features;
}

/// A pair of frames with known truth, and their matches.
struct AlignmentScene {
  Features reference;
  Features target;
  std::vector<Correspondence> matches;

  /// The target's keypoints are the reference's mapped by `truth`.
  AlignmentScene(const cv::Mat& reference_image, const cv::Mat& target_image,
                 const Eigen::Matrix3d& truth, double spacing = 25.0, double margin = 40.0)
      : reference(gridFeatures(reference_image, spacing, margin)),
        target(gridFeatures(target_image, spacing, margin)) {
    target.keypoints.clear();
    for (std::size_t i = 0; i < reference.size(); ++i) {
      const cv::Point2f& x = reference.keypoints[i].pt;
      const Eigen::Vector2d u = apply(truth, {x.x, x.y});
      target.keypoints.emplace_back(static_cast<float>(u.x()), static_cast<float>(u.y()), 31.F);
      const auto index = static_cast<std::int32_t>(i);
      matches.push_back({index, index, 20, 80, Level::ktgp});
    }
  }
};

/// The scene of a picture and a camera that moves by `truth`; `shade` changes the grey values.
inline AlignmentScene planeScene(
    unsigned seed, const Eigen::Matrix3d& truth,
    const std::function<double(double)>& shade = [](double grey) { return grey; },
    const cv::Size& size = {640, 480}) {
  const WavePicture picture(seed);
  const Eigen::Matrix3d back = truth.inverse();
  return {render(size, [&](const Eigen::Vector2d& x) { return picture.at(x); }),
          render(size, [&](const Eigen::Vector2d& x) { return shade(picture.at(apply(back, x))); }),
          truth};
}

/// Turn by `degrees`, zoom and tilt about the centre of an image.
inline Eigen::Matrix3d turn(double degrees, double zoom,
                            const Eigen::RowVector2d& tilt = Eigen::RowVector2d::Zero(),
                            const cv::Size& size = {640, 480}) {
  Eigen::Matrix3d h = Eigen::Matrix3d::Identity();
  const double a = degrees * 0.017453292519943295;
  h.topLeftCorner<2, 2>() << zoom * std::cos(a), -zoom * std::sin(a), zoom * std::sin(a),
      zoom * std::cos(a);
  h.bottomLeftCorner<1, 2>() = tilt;
  const double x = 0.5 * (size.width - 1);
  const double y = 0.5 * (size.height - 1);
  return translation(x, y) * h * translation(-x, -y);
}

/// A covariance like that of a homography from keypoints: some tenths of a pixel at the corners.
inline Covariance8 keypointCovariance() {
  Covariance8 covariance = Covariance8::Zero();
  for (int i : {0, 1, 3, 4}) covariance(i, i) = 1e-6;
  for (int i : {2, 5}) covariance(i, i) = 0.1;
  for (int i : {6, 7}) covariance(i, i) = 1e-12;
  return covariance;
}

inline UncertainHomography uncertain(const Eigen::Matrix3d& homography) {
  UncertainHomography estimate;
  estimate.homography = homography;
  estimate.covariance = keypointCovariance();
  return estimate;
}

}  // namespace ktgp_orb::test
