#pragma once

#include <opencv2/core.hpp>

#include "ktgp_orb/features.h"
#include "ktgp_orb/ktgp_matcher.h"
#include "ktgp_orb/orb_extractor.h"

namespace ktgp_orb {

/// Options for two images.
struct PairOptions {
  OrbOptions orb;
  MatcherOptions matcher;
  /// More than OrbOptions::max_features for images of more than a megapixel, up to 8000: larger
  /// images have more details to tell apart.
  bool features_by_area = false;

  /// For two photographs of any kind, as preset photo: finds most, in seconds rather than
  /// milliseconds.
  static PairOptions photo();
};

/// Two images and the result for them.
struct PairMatch {
  Features reference;
  Features target;
  int max_features = 0;  ///< most keypoints per image, after PairOptions::features_by_area
  double reference_milliseconds = 0.0;  ///< time to find the features
  double target_milliseconds = 0.0;
  MatchResult match;
};

/// Matches two images, 8-bit grey. With GrowthOptions::views, views of the reference are simulated
/// where nothing is found without them, since they take longer than all the rest. Throws
/// std::invalid_argument as OrbExtractor and KtgpMatcher do.
PairMatch matchPair(const cv::Mat& reference, const cv::Mat& target,
                    const PairOptions& options = PairOptions::photo(),
                    const MatchHints& hints = {});

}  // namespace ktgp_orb
