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
  /// If true, both images may get more features than OrbOptions::max_features: at least 4000 for a
  /// two-view geometry, which needs matches in all parts of the scene; and if the larger image has
  /// more than a megapixel, a number in proportion to its area, up to 8000.
  bool features_by_area = false;

  /// The preset photo, for two photographs of any kind. Of all presets, it succeeds on the largest
  /// number of image pairs, but it takes seconds instead of milliseconds.
  static PairOptions photo();
};

/// Features of two images and the result of matching them.
struct PairMatch {
  Features reference;
  Features target;
  /// The OrbOptions::max_features used for both images; see PairOptions::features_by_area.
  int max_features = 0;
  double reference_milliseconds = 0.0;  ///< time to find the features of the reference
  double target_milliseconds = 0.0;
  MatchResult match;
};

/// Matches two 8-bit grey images. If GrowthOptions::views is set, the images are first matched
/// without simulated views. Views of the reference are simulated only if this finds no geometry,
/// because they take longer than all other steps. Throws std::invalid_argument in the same cases as
/// OrbExtractor and KtgpMatcher.
PairMatch matchPair(const cv::Mat& reference, const cv::Mat& target,
                    const PairOptions& options = PairOptions::photo(),
                    const MatchHints& hints = {});

}  // namespace ktgp_orb
