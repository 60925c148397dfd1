#pragma once

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

namespace ktgp_orb::test {

/// The image whose pixel at (x, y) has the value `grey(x, y)`.
template <typename Grey>
cv::Mat drawn(const cv::Size& size, const Grey& grey) {
  cv::Mat image(size, CV_8U);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      image.at<std::uint8_t>(y, x) = cv::saturate_cast<std::uint8_t>(grey(x, y));
    }
  }
  return image;
}

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

/// Rectangles of random size, place and brightness, one for each `area` px: isolated corners among
/// flat parts, or with less area corners everywhere.
inline cv::Mat blockImage(const cv::Size& size, std::uint64_t seed, int area = 1500) {
  cv::Mat image(size, CV_8U, cv::Scalar(90));
  cv::RNG rng(seed);
  for (int i = 0; i < size.area() / area; ++i) {
    const cv::Point corner(rng.uniform(0, size.width), rng.uniform(0, size.height));
    const cv::Size extent(rng.uniform(3, 40), rng.uniform(3, 40));
    cv::rectangle(image, cv::Rect(corner, extent), cv::Scalar(rng.uniform(0, 256)), cv::FILLED);
  }
  return image;
}

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

inline cv::Mat flatImage(const cv::Size& size, int grey) {
  return cv::Mat(size, CV_8U, cv::Scalar(grey));
}

inline cv::Mat gradientImage(const cv::Size& size) {
  return drawn(size, [](int x, int y) { return (2 * x + 3 * y) % 256; });
}

inline cv::Mat checkerboardImage(const cv::Size& size, int square) {
  return drawn(size, [=](int x, int y) { return (x / square + y / square) % 2 * 255; });
}

/// The image with normal noise of that deviation.
inline cv::Mat withNoise(const cv::Mat& image, double deviation, std::uint64_t seed) {
  if (deviation <= 0.0) return image.clone();
  cv::Mat noise(image.size(), CV_32F);
  cv::RNG(seed).fill(noise, cv::RNG::NORMAL, 0.0, deviation);
  cv::Mat noisy;
  cv::add(image, noise, noisy, cv::noArray(), CV_8U);
  return noisy;
}

/// The same pixels in the middle of a larger image: rows are not contiguous.
inline cv::Mat asRegion(const cv::Mat& image, int left, int right) {
  cv::Mat parent(image.rows + 3, image.cols + left + right, CV_8U, cv::Scalar(170));
  cv::Mat region = parent(cv::Rect(left, 1, image.cols, image.rows));
  image.copyTo(region);
  return region;
}

}  // namespace ktgp_orb::test
