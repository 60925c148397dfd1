#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <opencv2/core/types.hpp>
#include <vector>

#include "core/growth/local_matcher.h"
#include "core/growth/map_fit.h"
#include "core/growth/verdict.h"

namespace ktgp_orb::growth {

/// The result for a seed.
struct Grown {
  Eigen::Matrix3d map;
  Judgement judgement;
  std::vector<LocalMatch> matches;
  std::vector<PlacePair> pairs;      // the same
  std::vector<cv::Point2f> repeats;  // see Verdict::repeats
  bool grew_from_repeats = false;    // it was also grown from the repetitions
};

/// A facade also fits itself shifted by one window, and a rose window rotated by one spoke. Such a
/// homography is not due to chance, but may be wrong. Keeps its buffers.
class Rivals {
 public:
  /// Whether `rival` has not significantly fewer matches than `grown`, and many of them lie where
  /// those of `grown` are in the target but come from elsewhere. `target`: its size.
  bool contradicts(const Grown& rival, const Grown& grown, const cv::Size& target);

 private:
  std::size_t cellOf(const Eigen::Vector2d& target) const;

  std::size_t columns_ = 0;
  std::size_t rows_ = 0;
  std::vector<std::uint8_t> covered_;  // cells of the target with matches
};

}  // namespace ktgp_orb::growth
