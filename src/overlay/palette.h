#pragma once

#include <algorithm>
#include <array>
#include <opencv2/core/types.hpp>

#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/two_view.h"

namespace ktgp_orb::overlay {

/// A stage's colour (BGR) and the panel's text for the matches that it removed.
struct StageLook {
  cv::Scalar colour;
  const char* label;
};

/// By Level, from knn to ktgp; final matches of an epipolar geometry are green. Colours of Okabe &
/// Ito, "Color Universal Design" (2008), which all kinds of colour vision can distinguish; grey for
/// the background.
inline const StageLook& lookOf(Level level, Geometry geometry) {
  static const StageLook epipolar{{115, 158, 0}, "final"};
  static const std::array<StageLook, 4> looks{{
      {{150, 150, 150}, "- ratio"},
      {{233, 180, 86}, "- GMS"},
      {{167, 121, 204}, "- PROSAC"},
      {{66, 228, 240}, "final"},
  }};
  if (level >= Level::ktgp && geometry == Geometry::epipolar) return epipolar;
  return looks[std::min<std::size_t>(static_cast<std::size_t>(level), looks.size() - 1)];
}

inline const cv::Scalar kWhite(255, 255, 255);
inline const cv::Scalar kBlack(0, 0, 0);

}  // namespace ktgp_orb::overlay
