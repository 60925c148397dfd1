#pragma once

#include <opencv2/core.hpp>

#include "ktgp_orb/features.h"
#include "ktgp_orb/ktgp_matcher.h"
#include "ktgp_orb/orb_extractor.h"

namespace ktgp_orb {

/// Options of matchPair().
struct PairOptions {
  OrbOptions orb;
  MatcherOptions matcher;
  /// If true, images of more than a megapixel get more features than OrbOptions::max_features, in
  /// proportion to their area, up to 8000. Larger images show more details that can be told apart.
  bool features_by_area = false;

  /// The preset photo, for two photographs of any kind. Of all presets, it succeeds on the largest
  /// number of image pairs, but it takes seconds instead of milliseconds.
  static PairOptions photo();
};

/// Features of two images and the result of matching them.
struct PairMatch {
  Features reference;
  Features target;
  /// Maximum number of keypoints per image that was used, see PairOptions::features_by_area.
  int max_features = 0;
  double reference_milliseconds = 0.0;  ///< time to find the features of the reference
  double target_milliseconds = 0.0;
  MatchResult match;
};

/// Matches two images, 8-bit grey. With GrowthOptions::views, views of the reference are simulated
/// only if no geometry is found without them, because they take longer than everything else. Throws
/// std::invalid_argument as OrbExtractor and KtgpMatcher do.
PairMatch matchPair(const cv::Mat& reference, const cv::Mat& target,
                    const PairOptions& options = PairOptions::photo(),
                    const MatchHints& hints = {});

}  // namespace ktgp_orb
