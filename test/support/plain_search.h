#pragma once

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <bitset>
#include <limits>
#include <random>
#include <string>
#include <tuple>
#include <vector>

#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/features.h"
#include "ktgp_orb/knn_matcher.h"

/// The definitions of the nearest neighbours, pair by pair, that the tests compare with.
namespace ktgp_orb::test {

inline int hamming(const std::uint8_t* a, const std::uint8_t* b) {
  int distance = 0;
  for (int i = 0; i < kDescriptorBytes; ++i) {
    distance += static_cast<int>(std::bitset<8>(a[i] ^ b[i]).count());
  }
  return distance;
}

constexpr int kNoDistance = 1000;

/// The nearest two of each target, and whether it is the nearest of its nearest. `is_allowed(r,
/// t)`: whether reference r may match target t. Distances are kNoDistance where there is none.
template <typename IsAllowed>
std::vector<Correspondence> plainSearch(const cv::Mat& reference, const cv::Mat& target,
                                        const IsAllowed& is_allowed) {
  std::vector<Correspondence> found;
  std::vector<int> best(static_cast<std::size_t>(reference.rows), kNoDistance);
  std::vector<int> nearest(best.size(), -1);
  for (int t = 0; t < target.rows && reference.rows > 0; ++t) {
    Correspondence c{-1, t, kNoDistance, kNoDistance, Level::knn, false};
    for (int r = 0; r < reference.rows; ++r) {
      if (!is_allowed(r, t)) continue;
      const int distance = hamming(reference.ptr(r), target.ptr(t));
      const auto of = static_cast<std::size_t>(r);
      if (distance < best[of]) {
        best[of] = distance;
        nearest[of] = t;
      }
      if (distance < c.distance) {
        c.second_distance = c.distance;
        c.distance = distance;
        c.reference_index = r;
      } else {
        c.second_distance = std::min(c.second_distance, distance);
      }
    }
    found.push_back(c);
  }
  for (Correspondence& c : found) {
    if (c.reference_index < 0) continue;
    c.mutual = nearest[static_cast<std::size_t>(c.reference_index)] == c.target_index;
  }
  return found;
}

/// Random keypoints, also up to `beyond` px outside of the image, and descriptors whose bytes are
/// at most `highest`.
inline Features randomFeatures(int count, std::uint32_t seed, const cv::Size& size,
                               float beyond = 0.F, int highest = 255) {
  std::mt19937 random(seed);
  const auto place = [&](int length) {
    return std::uniform_real_distribution<float>(-beyond,
                                                 static_cast<float>(length) + beyond)(random);
  };
  std::uniform_int_distribution<int> byte(0, highest);
  Features features;
  features.image_size = size;
  features.descriptors.create(count, kDescriptorBytes, CV_8U);
  for (int i = 0; i < count; ++i) {
    const float x = place(size.width);
    features.keypoints.emplace_back(x, place(size.height), 31.F);
    for (int b = 0; b < kDescriptorBytes; ++b) {
      features.descriptors.at<std::uint8_t>(i, b) = static_cast<std::uint8_t>(byte(random));
    }
  }
  return features;
}

/// KnnMatcher::match, or matchMutual.
inline std::vector<Correspondence> plainSearch(const cv::Mat& reference, const cv::Mat& target,
                                               bool mutual) {
  auto found = plainSearch(reference, target, [](int, int) { return true; });
  for (Correspondence& c : found) {
    if (reference.rows == 1) c.second_distance = 0;
    c.mutual &= mutual;
  }
  return found;
}

/// KnnMatcher::matchNear.
inline std::vector<Correspondence> plainNearSearch(const Features& reference,
                                                   const Features& target,
                                                   const Eigen::Matrix3d& prediction, double radius,
                                                   bool mutual) {
  Eigen::Matrix3d back = prediction.inverse();
  const Eigen::Vector3d middle(0.5 * target.image_size.width, 0.5 * target.image_size.height, 1.0);
  if (back.row(2).dot(middle) < 0.0) back = -back;  // the image is in front of the camera
  std::vector<cv::Point2f> places;
  for (const cv::KeyPoint& keypoint : target.keypoints) {
    const Eigen::Vector3d p = back * Eigen::Vector3d(keypoint.pt.x, keypoint.pt.y, 1.0);
    places.emplace_back(std::numeric_limits<float>::quiet_NaN(), 0.0F);
    if (!(p.z() > 0.0)) continue;
    places.back() = {static_cast<float>(p.x() / p.z()), static_cast<float>(p.y() / p.z())};
  }
  const auto squared_radius = static_cast<float>(radius) * static_cast<float>(radius);
  auto found = plainSearch(reference.descriptors, target.descriptors, [&](int r, int t) {
    const cv::Point2f& p = reference.keypoints[static_cast<std::size_t>(r)].pt;
    const cv::Point2f& place = places[static_cast<std::size_t>(t)];
    const float dx = p.x - place.x;
    const float dy = p.y - place.y;
    const float xx = dx * dx;
    const float yy = dy * dy;
    return xx + yy <= squared_radius;
  });
  for (Correspondence& c : found) {
    if (c.reference_index < 0) c.distance = c.second_distance = 8 * kDescriptorBytes;
    if (c.second_distance == kNoDistance) {
      c.second_distance = std::max(c.distance, kUnrelatedDistance);
    }
    c.mutual &= mutual;
  }
  return found;
}

inline testing::AssertionResult same(const std::vector<Correspondence>& actual,
                                     const std::vector<Correspondence>& expected) {
  if (actual.size() != expected.size()) {
    return testing::AssertionFailure()
           << actual.size() << " correspondences instead of " << expected.size();
  }
  const auto fields = [](const Correspondence& c) {
    return std::tie(c.target_index, c.reference_index, c.distance, c.second_distance, c.level,
                    c.mutual);
  };
  const auto text = [](const Correspondence& c) {
    return std::to_string(c.target_index) + " -> " + std::to_string(c.reference_index) + " at " +
           std::to_string(c.distance) + ", second " + std::to_string(c.second_distance) +
           ", level " + std::to_string(static_cast<int>(c.level)) + (c.mutual ? ", mutual" : "");
  };
  for (std::size_t i = 0; i < actual.size(); ++i) {
    if (fields(actual[i]) == fields(expected[i])) continue;
    return testing::AssertionFailure() << text(actual[i]) << " instead of " << text(expected[i]);
  }
  return testing::AssertionSuccess();
}

}  // namespace ktgp_orb::test
