#pragma once

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

namespace ktgp_orb::test {

/// Grey noise, equal for equal seeds.
inline cv::Mat noiseImage(const cv::Size& size, std::uint64_t seed) {
  cv::Mat image(size, CV_8U);
  cv::RNG(seed).fill(image, cv::RNG::UNIFORM, 0, 256);
  return image;
}

/// Noise at several scales: corners of every size and strength, as in a textured scene.
inline cv::Mat textureImage(const cv::Size& size, std::uint64_t seed) {
  cv::Mat sum = cv::Mat::zeros(size, CV_32F);
  for (int period = 2; period <= 32; period *= 2) {
    const cv::Size coarse(size.width / period + 2, size.height / period + 2);
    cv::Mat layer;
    cv::resize(noiseImage(coarse, seed + static_cast<std::uint64_t>(period)), layer, size, 0, 0,
               cv::INTER_CUBIC);
    cv::accumulateWeighted(layer, sum, 0.4);
  }
  cv::Mat image;
  cv::normalize(sum, image, 0, 255, cv::NORM_MINMAX, CV_8U);
  return image;
}

/// Rectangles of random size, place and brightness: isolated corners among flat parts.
inline cv::Mat blockImage(const cv::Size& size, std::uint64_t seed) {
  cv::Mat image(size, CV_8U, cv::Scalar(90));
  cv::RNG rng(seed);
  for (int i = 0; i < size.area() / 1500; ++i) {
    const cv::Point corner(rng.uniform(0, size.width), rng.uniform(0, size.height));
    const cv::Size extent(rng.uniform(3, 40), rng.uniform(3, 40));
    cv::rectangle(image, cv::Rect(corner, extent), cv::Scalar(rng.uniform(0, 256)), cv::FILLED);
  }
  return image;
}

inline cv::Mat flatImage(const cv::Size& size, int grey) {
  return cv::Mat(size, CV_8U, cv::Scalar(grey));
}

inline cv::Mat gradientImage(const cv::Size& size) {
  cv::Mat image(size, CV_8U);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      image.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>((2 * x + 3 * y) % 256);
    }
  }
  return image;
}

inline cv::Mat checkerboardImage(const cv::Size& size, int square) {
  cv::Mat image(size, CV_8U);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      image.at<std::uint8_t>(y, x) = (x / square + y / square) % 2 != 0 ? 255 : 0;
    }
  }
  return image;
}

/// The same pixels in the middle of a larger image: rows are not contiguous.
inline cv::Mat asRegion(const cv::Mat& image, int left, int right) {
  cv::Mat parent(image.rows + 3, image.cols + left + right, CV_8U, cv::Scalar(170));
  cv::Mat region = parent(cv::Rect(left, 1, image.cols, image.rows));
  image.copyTo(region);
  return region;
}

}  // namespace ktgp_orb::test
