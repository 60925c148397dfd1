#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <opencv2/core/types.hpp>
#include <vector>

#include "growth/local_frame.h"
#include "util/cell_grid.h"

namespace ktgp_orb::growth {

/// Counts for each match how many other matches agree with it. The two keypoints of a match give a
/// local rotation and scale, and so a similarity transform. A match gets a vote from each near
/// match that has a similar rotation and scale and whose target keypoint is where this transform
/// predicts it. (In Lowe, IJCV 2004, each match votes for a pose of the whole object; here the
/// transform must hold only nearby, so perspective does no harm.) Votes count once per 8x8 px of
/// either image, so a corner found in several octaves, or a cluster of corners, counts once. Reuses
/// its buffers from call to call.
class Votes {
 public:
  /// Two keypoints that may show the same point, and the similarity transform that they give.
  struct Similarity {
    float x, y, u, v;    ///< positions in the reference (x, y) and in the target (u, v), px
    float cosine, sine;  ///< cosine and sine of the rotation
    /// Ratio of the target keypoint's size to the reference keypoint's size, and its logarithm.
    float scale, log_scale;
    std::uint32_t from_cell, to_cell;  ///< cells of the two keypoints; each cell votes once
  };

  void clear() { pairs_.clear(); }
  void add(const LocalFrame& from, const LocalFrame& to);
  const Similarity& pair(std::int32_t number) const {
    return pairs_[static_cast<std::size_t>(number)];
  }

  static constexpr float kReach = 120.F;  ///< px
  static constexpr std::int32_t kAll = std::numeric_limits<std::int32_t>::max();

  /// Counts the votes for all pairs. `from`, `to`: sizes of the images. `enough`: no more votes
  /// than this are counted for a pair, which saves time. `reach`: largest distance between a match
  /// and its voters, px of the reference.
  void count(const cv::Size& from, const cv::Size& to, std::int32_t enough = kAll,
             float reach = kReach);

  /// Number of votes of each pair, at most `enough`.
  const std::vector<std::int32_t>& votes() const { return votes_; }

  /// Sets `voters` to the pairs that vote for pair `number`.
  void voters(std::int32_t number, std::vector<std::int32_t>& voters) const;

 private:
  bool votesFor(const Similarity& voter, const Similarity& pair) const;

  float reach_ = kReach;
  util::CellGrid cells_;
  std::vector<Similarity> pairs_;
  // For each cell, 1 + the index of the last pair that the cell voted for.
  std::vector<std::uint32_t> from_voted_;
  std::vector<std::uint32_t> to_voted_;
  std::vector<std::int32_t> votes_;
};

}  // namespace ktgp_orb::growth
