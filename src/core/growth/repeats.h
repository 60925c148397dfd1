#pragma once

#include <cstdint>
#include <opencv2/core/types.hpp>
#include <vector>

#include "core/growth/local_frame.h"
#include "core/growth/local_matcher.h"

namespace ktgp_orb::growth {

/// Repetitions of a scene, such as windows of a facade or lines of letters: the most frequent
/// displacements from a predicted keypoint to target keypoints that look like it, within some
/// distance. Keeps its buffers.
class Repeats {
 public:
  /// The most frequent shifts in px, at most kMost, none within 10 px of zero.
  const std::vector<cv::Point2f>& find(const std::vector<Prediction>& predictions,
                                       const std::vector<Bits>& reference,
                                       const LocalMatcher& matcher);

  /// Of the last call.
  const std::vector<cv::Point2f>& shifts() const { return shifts_; }

  static constexpr std::size_t kMost = 16;

 private:
  struct Bin {
    std::int32_t votes;
    float x, y;  // sums of the displacements
  };

  std::vector<Bin> bins_;
  std::vector<std::int32_t> order_;
  std::vector<cv::Point2f> shifts_;
};

}  // namespace ktgp_orb::growth
