#pragma once

#include <cmath>
#include <cstdint>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "python/match.h"

namespace ktgp_orb::python {

/// The result for a frame of a sequence.
struct FrameMatch : Match {
  using Match::Match;
  std::string no_reference;
  std::optional<Eigen::Matrix3d> accumulated;
  std::int64_t stamp = 0;  ///< ns
  std::int64_t reference_stamp = 0;
  cv::Size image_size;
  std::vector<std::uint64_t> tracks;  ///< of the target keypoints, for each match
};

inline double secondsOf(std::int64_t stamp) {
  return 1e-9 * static_cast<double>(stamp);
}

}  // namespace ktgp_orb::python
