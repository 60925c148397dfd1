#pragma once

#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

namespace ktgp_orb {

/// Bytes of one descriptor (256 bits).
constexpr int kDescriptorBytes = 32;

/// Meaning of the bits of a descriptor. Only descriptors of the same kind can be compared.
enum class DescriptorKind : std::uint8_t {
  orb,     ///< rBRIEF: pairs of pixels (Rublee et al., ICCV 2011)
  teblid,  ///< TEBLID-256: pairs of box means (Suarez, Buenaposada & Baumela, RA-L 2021)
};

/// Returns "orb" or "teblid".
const char* toString(DescriptorKind kind);

/// Keypoints of an image, their descriptors, and the size of the image, which GMS and the checks of
/// the homography need.
struct Features {
  /// Keypoints, with positions in pixels: x right, y down, origin at the centre of the top-left
  /// pixel.
  std::vector<cv::KeyPoint> keypoints;
  /// One row of 32 bytes (CV_8U) per keypoint, in the order of `keypoints`.
  cv::Mat descriptors;
  /// Width and height of the image in pixels.
  cv::Size image_size;
  /// The 8-bit grey image and the smaller levels of ORB's image pyramid. Only alignment needs them;
  /// see OrbOptions::images.
  std::vector<cv::Mat> images;
  /// What the bits of `descriptors` mean.
  DescriptorKind descriptor = DescriptorKind::orb;

  std::size_t size() const { return keypoints.size(); }
  bool empty() const { return keypoints.empty(); }
};

/// Throws std::invalid_argument unless `features` is empty or has a positive image size.
void requireImageSize(const Features& features, const std::string& name);

/// Throws std::invalid_argument unless `features` has one 32-byte CV_8U descriptor row per keypoint
/// and, if it has keypoints, a positive image size. The message begins with `name`, such as
/// "reference" or "target".
void requireValid(const Features& features, const std::string& name);

/// Throws std::invalid_argument unless both frames have the same kind of descriptors.
void requireSameDescriptor(const Features& reference, const Features& target);

/// Throws std::invalid_argument unless `descriptors` is empty or CV_8U with 32 columns.
void requireDescriptors(const cv::Mat& descriptors, const std::string& name);

}  // namespace ktgp_orb
