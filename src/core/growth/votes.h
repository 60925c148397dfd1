#pragma once

#include <cstddef>
#include <cstdint>
#include <opencv2/core/types.hpp>
#include <vector>

#include "core/growth/local_frame.h"
#include "core/util/cell_grid.h"

namespace ktgp_orb::growth {

/// Two keypoints that may show the same point.
struct FramePair {
  LocalFrame from;
  LocalFrame to;
};

/// A match is a similarity: its keypoints give the local rotation and scale. It gets a vote from
/// each near match with similar rotation and scale at the position that the similarity predicts.
/// (In Lowe, IJCV 2004, each match votes for a pose of the whole object; here the pose must hold
/// only nearby, so perspective does no harm.) Votes count once per 8x8 px of either image: a corner
/// found in several octaves, or a cluster of corners, counts once. Keeps its buffers.
class Votes {
 public:
  /// Counts the votes for all pairs. `from`, `to`: sizes of the images.
  void count(const std::vector<FramePair>& pairs, const cv::Size& from, const cv::Size& to);

  /// Number of votes of each pair.
  const std::vector<std::int32_t>& votes() const { return votes_; }

  /// The pairs that vote for `pair`, without itself.
  void voters(std::size_t pair, std::vector<std::int32_t>& voters) const;

 private:
  /// The similarity of a pair.
  struct Similarity {
    float x, y, u, v;        // its positions
    float cosine, sine;      // of the rotation
    float scale, log_scale;  // target over reference
    std::uint32_t from_cell, to_cell;
  };

  bool votesFor(const Similarity& voter, const Similarity& pair) const;

  util::CellGrid cells_;
  std::vector<Similarity> similarities_;
  std::vector<std::uint32_t> from_voted_;  // for each cell, the last pair that it voted for, plus 1
  std::vector<std::uint32_t> to_voted_;
  std::vector<std::int32_t> votes_;
};

}  // namespace ktgp_orb::growth
