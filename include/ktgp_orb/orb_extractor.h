#pragma once

#include <memory>
#include <opencv2/core.hpp>

#include "ktgp_orb/features.h"

namespace ktgp_orb {

/// ORB parameters; the defaults are the paper's (section IV, "Experimental Results").
struct OrbOptions {
  int features = 2000;        ///< keypoints to keep at most, >= 1
  double scale_factor = 1.2;  ///< size ratio of neighbouring pyramid levels, in (1, 2]
  int levels = 8;             ///< pyramid levels, 1..16
  int fast_threshold = 20;    ///< FAST corner threshold in grey values, 1..255

  bool operator==(const OrbOptions& other) const;
  bool operator!=(const OrbOptions& other) const { return !(*this == other); }
};

/// Finds ORB keypoints (Rublee et al., ICCV 2011) and their 256-bit rBRIEF descriptors.
class OrbExtractor {
 public:
  /// Throws std::invalid_argument naming the option and its range.
  explicit OrbExtractor(const OrbOptions& options = {});
  ~OrbExtractor();
  OrbExtractor(OrbExtractor&&) noexcept;
  OrbExtractor& operator=(OrbExtractor&&) noexcept;

  const OrbOptions& options() const;

  /// `image`: 8-bit grey, any stride; an empty image gives no features. Throws
  /// std::invalid_argument for any other type. Buffers of `features` are reused.
  void extract(const cv::Mat& image, Features& features);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ktgp_orb
