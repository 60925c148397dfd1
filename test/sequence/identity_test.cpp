// The same input gives the same result on every machine, x86-64 or arm64: what is recorded here
// came from an x86-64 one. dev/check_arm64 runs this test on an emulated arm64.

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <vector>

#include "ktgp_orb/sequence_matcher.h"

namespace ktgp_orb {
namespace {

/// FNV-1a.
class Hash {
 public:
  template <typename T>
  void add(const T& value) {
    std::uint8_t bytes[sizeof(T)];
    std::memcpy(bytes, &value, sizeof(T));
    for (const std::uint8_t byte : bytes) hash_ = (hash_ ^ byte) * 0x100000001b3U;
  }
  std::uint64_t value() const { return hash_; }

 private:
  std::uint64_t hash_ = 0xcbf29ce484222325U;
};

/// Blocks of many sizes and grey values, using only integers.
cv::Mat world() {
  cv::Mat image(700, 900, CV_8U, cv::Scalar(100));
  std::uint32_t state = 12345;
  const auto next = [&](std::uint32_t below) {
    state = state * 1664525U + 1013904223U;
    return static_cast<int>((state >> 8) % below);
  };
  for (int i = 0; i < 9000; ++i) {
    // In separate statements: compilers evaluate arguments in different orders.
    const int height = 2 + next(24);
    const int width = 2 + next(24);
    const int top = next(700);
    const int left = next(900);
    const cv::Rect block(left, top, width, height);
    image(block & cv::Rect(0, 0, 900, 700)).setTo(next(256));
  }
  return image;
}

/// Frames of a camera that moves by whole pixels, each with its own noise.
cv::Mat frame(const cv::Mat& of, int i) {
  cv::Mat image = of(cv::Rect(10 + 9 * i, 20 + 5 * i, 640, 480)).clone();
  std::uint32_t state = 777U + static_cast<std::uint32_t>(i);
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      state = state * 1664525U + 1013904223U;
      auto& pixel = image.at<std::uint8_t>(y, x);
      pixel = cv::saturate_cast<std::uint8_t>(pixel + static_cast<int>(state >> 29) - 4);
    }
  }
  return image;
}

void add(const Features& features, Hash& keypoints, Hash& descriptors) {
  for (const cv::KeyPoint& k : features.keypoints) {
    keypoints.add(k.pt.x);
    keypoints.add(k.pt.y);
    keypoints.add(k.size);
    keypoints.add(k.angle);
    keypoints.add(k.response);
    keypoints.add(k.octave);
  }
  for (int row = 0; row < features.descriptors.rows; ++row) {
    for (int i = 0; i < kDescriptorBytes; ++i) {
      descriptors.add(features.descriptors.at<std::uint8_t>(row, i));
    }
  }
}

struct Identity {
  Hash keypoints;
  Hash descriptors;
  Hash neighbours;  // KNN with its distances, and what passed TF and GMS
  Hash inliers;     // inliers of PROSAC
  Eigen::Matrix3d homography = Eigen::Matrix3d::Zero();
};

Identity run(double search_radius, bool turned) {
  SequenceOptions options;
  options.matcher.knn.search_radius = search_radius;
  options.matcher.gms.rotation = options.matcher.gms.scale = turned;
  SequenceMatcher matcher(options);
  const cv::Mat image = world();
  Identity identity;
  for (int i = 0; i < 4; ++i) {
    const SequenceMatch& match = matcher.match(frame(image, i), 0.1 * i);
    add(match.frame->features, identity.keypoints, identity.descriptors);
    for (const Correspondence& c : match.match.correspondences) {
      identity.neighbours.add(c.reference_index);
      identity.neighbours.add(c.distance);
      identity.neighbours.add(c.second_distance);
      identity.neighbours.add(std::min(c.level, Level::ktg));
      identity.inliers.add(c.level);
    }
    identity.homography = match.match.answer.homography;
  }
  return identity;
}

TEST(Identity, KeypointsAndDescriptorsEqualX86) {
  const Identity identity = run(0.0, false);
  EXPECT_EQ(identity.keypoints.value(), 0x2520e3a28f5d4318U);
  EXPECT_EQ(identity.descriptors.value(), 0x866ceb1cd0b3c1baU);
}

TEST(Identity, MatchesEqualX86) {
  EXPECT_EQ(run(0.0, false).neighbours.value(), 0xed2c5fe6c86ce690U);
  EXPECT_EQ(run(0.0, true).neighbours.value(), 0x37bc9c19f5d1eff3U);
  EXPECT_EQ(run(30.0, false).neighbours.value(), 0x1d4873fe1ce80ee5U);
}

TEST(Identity, InliersEqualX86) {
  EXPECT_EQ(run(0.0, false).inliers.value(), 0xe065e584b13d755bU);
}

TEST(Identity, TheHomographyIsThatOfX86) {
  Eigen::Matrix3d expected;
  expected << 0.99999667777372325, 9.1080612734448313e-07, -8.9994226772598349,
      5.3715532521772067e-07, 0.99998810325421628, -4.9982707202119308, 2.8291220183849068e-09,
      -1.7022458724566127e-08, 1.0;
  const Eigen::Matrix3d h = run(0.0, false).homography;
  const Eigen::IOFormat all_digits(17);
  EXPECT_LT((h - expected).norm(), 1e-7) << h.format(all_digits);
#if EIGEN_VERSION_AT_LEAST(3, 4, 0)  // earlier ones add in another order
  EXPECT_EQ(h, expected) << h.format(all_digits);
#endif
}

}  // namespace
}  // namespace ktgp_orb
