#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>

#include "ktgp_orb/features.h"

namespace ktgp_orb::orb {
class OrbPipeline;
}

namespace ktgp_orb {

/// How keypoints are chosen from the corners.
enum class KeypointDistribution : std::uint8_t {
  ranked,  ///< the corners with the highest Harris response, as in cv::ORB
  /// About equally many keypoints from every part of the image. In parts with few corners, the FAST
  /// threshold is halved.
  uniform,
};

/// What the extractor stores in Features::images.
enum class ImageKeeping : std::uint8_t {
  none,   ///< Features::images stays empty, so sub-pixel alignment is not possible
  copy,   ///< the image is copied and its pyramid kept
  share,  ///< the image is kept without a copy; do not write to it while the features are in use
};

/// ORB parameters. The defaults are the values of the paper (section IV, "Experimental Results").
struct OrbOptions {
  int max_features = 2000;    ///< maximum number of keypoints, >= 1
  double scale_factor = 1.2;  ///< size ratio of neighbouring pyramid levels, in [1.01, 2]
  int levels = 8;             ///< number of pyramid levels, 1..16
  /// Index of the pyramid level that has the size of the image, in [0, levels - 1], as in cv::ORB.
  /// The levels before it are enlarged copies; each is larger than the next level by scale_factor.
  /// They show details that are too small for a patch of 31 px. With TEBLID, the index must be 0.
  int first_level = 0;
  int fast_threshold = 20;  ///< FAST corner threshold in grey values, 1..255
  /// If a frame has fewer corners than a quarter of `max_features`, the threshold is halved until
  /// there are enough corners, but not below 5 grey values. All other frames get exactly the same
  /// keypoints as without this option. Not in the paper.
  bool fast_adaptive = false;
  /// rBRIEF or TEBLID-256, both 256 bits. TEBLID tolerates larger changes of light and viewpoint.
  DescriptorKind descriptor = DescriptorKind::orb;
  KeypointDistribution distribution = KeypointDistribution::ranked;
  /// For the uniform distribution: keypoints per cell if all cells have enough corners, >= 1.
  /// Smaller cells spread the keypoints more evenly; larger cells allow a better choice of corners.
  int keypoints_per_cell = 16;
  ImageKeeping images = ImageKeeping::copy;
  /// Number of threads that share the work; 0 means all cores; the result does not depend on it.
  int threads = 1;

  bool operator==(const OrbOptions& other) const;
  bool operator!=(const OrbOptions& other) const { return !(*this == other); }
};

/// Finds ORB keypoints (Rublee et al., ICCV 2011) and their 256-bit descriptors.
///
/// TEBLID descriptors equal the output of OpenCV's xfeatures2d (scale factor 1) to the last bit.
///
/// With KeypointDistribution::ranked, the keypoints, their order and the rBRIEF descriptors equal
/// the output of cv::ORB::create(features, scale_factor, levels, 31, first_level, 2, HARRIS_SCORE,
/// 31, fast_threshold) of OpenCV 4.6 on a processor with AVX2, to the last bit. (On other
/// processors cv::ORB rounds its blur differently, which changes a descriptor bit in some frames;
/// this class gives the same bits on all processors.) If more corners have the same Harris response
/// as the last corner within `max_features`, this class keeps them, too, as cv::ORB does, and so
/// exceeds `max_features`.
///
/// An instance belongs to one thread at a time; several instances may work in parallel.
class OrbExtractor {
 public:
  /// Throws std::invalid_argument, naming the option and its range, if an option is out of range.
  explicit OrbExtractor(const OrbOptions& options = {});
  ~OrbExtractor();
  OrbExtractor(OrbExtractor&&) noexcept;
  OrbExtractor& operator=(OrbExtractor&&) noexcept;

  const OrbOptions& options() const;

  /// `image`: 8-bit grey, any stride. If the image is empty, or if a side of its largest pyramid
  /// level is shorter than 63 px, no features are found. Throws std::invalid_argument for an image
  /// of another type. The buffers of `features` are reused.
  void extract(const cv::Mat& image, Features& features);
  /// Finds keypoints only where `mask` is not zero (8-bit, the size of `image`; empty: everywhere).
  /// Throws std::invalid_argument for a mask of another type or size.
  void extract(const cv::Mat& image, const cv::Mat& mask, Features& features);

 private:
  std::unique_ptr<orb::OrbPipeline> pipeline_;
};

}  // namespace ktgp_orb
