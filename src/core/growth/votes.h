#pragma once

#include <cstddef>
#include <cstdint>
#include <opencv2/core/types.hpp>
#include <vector>

#include "core/growth/local_frame.h"
#include "core/util/cell_grid.h"

namespace ktgp_orb::growth {

/// Two keypoints that may show the same thing.
struct FramePair {
  LocalFrame from;
  LocalFrame to;
};

/// A match is a similarity by itself: its keypoints say how the image turns and scales there. It
/// has the vote of each match near it that turns and scales alike and lies where the similarity
/// puts it (Lowe, IJCV 2004, has each match vote for a pose of the whole object; here the pose need
/// only hold nearby, so that perspective does no harm). Votes count once per 8x8 px of either
/// image: a corner found in several octaves, or a cluster of them, is one thing. Keeps its buffers.
class Votes {
 public:
  /// Counts the votes of all pairs. `from`, `to`: sizes of the images.
  void count(const std::vector<FramePair>& pairs, const cv::Size& from, const cv::Size& to);

  /// Of each pair.
  const std::vector<std::int32_t>& votes() const { return votes_; }

  /// The pairs that vote for `pair`, without itself.
  void voters(std::size_t pair, std::vector<std::int32_t>& voters) const;

 private:
  /// What a pair says of the images around it.
  struct Similarity {
    float x, y, u, v;        // its places
    float cosine, sine;      // of the rotation
    float scale, log_scale;  // target over reference
    std::uint32_t from_cell, to_cell;
  };

  bool votesFor(const Similarity& voter, const Similarity& pair) const;

  util::CellGrid cells_;
  std::vector<Similarity> similarities_;
  std::vector<std::uint32_t> from_voted_;  // the last pair that each cell voted for, plus 1
  std::vector<std::uint32_t> to_voted_;
  std::vector<std::int32_t> votes_;
};

}  // namespace ktgp_orb::growth
