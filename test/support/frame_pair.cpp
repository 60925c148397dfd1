#include "frame_pair.h"

#include <Eigen/LU>
#include <cmath>
#include <opencv2/core/eigen.hpp>

namespace ktgp_orb::test {

Features featuresOf(const cv::Mat& image, const OrbOptions& options) {
  Features features;
  OrbExtractor(options).extract(image, features);
  return features;
}

FramePair::FramePair(const cv::Mat& reference_image, const cv::Mat& target_image,
                     const OrbOptions& options)
    : reference(featuresOf(reference_image, options)), target(featuresOf(target_image, options)) {}

MatchResult matched(const FramePair& pair, const MatcherOptions& options, const MatchHints& hints) {
  MatchResult result;
  KtgpMatcher(options).match(pair.reference, pair.target, hints, result);
  return result;
}

cv::Mat warped(const cv::Mat& image, const Eigen::Matrix3d& homography, const cv::Size& size,
               int interpolation) {
  cv::Mat h, moved;
  cv::eigen2cv(homography, h);
  cv::warpPerspective(image, moved, h, size, interpolation);
  return moved;
}

void addKeypoint(const Eigen::Vector2d& at, double angle, double size,
                 const std::vector<std::uint8_t>& descriptor, Features& features) {
  const double degrees = angle * 180.0 / M_PI;
  features.keypoints.emplace_back(
      static_cast<float>(at.x()), static_cast<float>(at.y()), static_cast<float>(size),
      static_cast<float>(degrees - 360.0 * std::floor(degrees / 360.0)));
  features.descriptors.push_back(
      cv::Mat(1, kDescriptorBytes, CV_8U, const_cast<std::uint8_t*>(descriptor.data())));
}

FramePair drawnPair(int count, int inliers, const Eigen::Matrix3d& truth, std::uint64_t seed,
                    int lures, int flips) {
  const cv::Size size(640, 480);
  Numbers numbers(seed);
  const auto anyDescriptor = [&] {
    std::vector<std::uint8_t> bits(kDescriptorBytes);
    for (std::uint8_t& b : bits) b = static_cast<std::uint8_t>(numbers.uniform(0.0, 256.0));
    return bits;
  };
  FramePair pair;
  pair.reference.image_size = pair.target.image_size = size;
  for (int i = 0; i < count; ++i) {
    const double angle = numbers.uniform(0.0, 2.0 * M_PI);
    const double length = 31.0 * std::pow(1.2, std::floor(numbers.uniform(0.0, 8.0)));
    Eigen::Vector2d x = numbers.pointIn(size);
    std::vector<std::uint8_t> bits = anyDescriptor();
    Eigen::Vector2d u = (truth * x.homogeneous()).hnormalized();
    while (i < inliers && !isInside(u, size)) {
      x = numbers.pointIn(size);
      u = (truth * x.homogeneous()).hnormalized();
    }
    addKeypoint(x, angle, length, bits, pair.reference);
    if (i >= inliers) {
      const Eigen::Vector2d anywhere = numbers.pointIn(size);
      const double any_angle = numbers.uniform(0.0, 2.0 * M_PI);
      addKeypoint(anywhere, any_angle, length, i < inliers + lures ? bits : anyDescriptor(),
                  pair.target);
      continue;
    }
    const Eigen::Vector2d step(std::cos(angle), std::sin(angle));
    const Eigen::Vector2d v = (truth * (x + step).homogeneous()).hnormalized() - u;
    for (int flip = 0; flip < flips; ++flip) {
      const auto bit = static_cast<std::size_t>(numbers.uniform(0.0, 256.0));
      bits[bit / 8] ^= static_cast<std::uint8_t>(1U << (bit % 8));
    }
    const Eigen::Vector2d noise(0.5 * numbers.normal(), 0.5 * numbers.normal());
    const double turned = std::atan2(v.y(), v.x()) + 0.1 * numbers.normal();
    addKeypoint(u + noise, turned, length * v.norm(), bits, pair.target);
  }
  return pair;
}

}  // namespace ktgp_orb::test
