#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "growth/local_frame.h"
#include "growth/reference_frames.h"
#include "targets/target_index.h"
#include "targets/vote_kernel.h"

namespace ktgp_orb::targets {

/// A pair of keypoints to grow a homography from, and the number of pairs that agree with it.
struct Seed {
  SeedMap map;
  std::int32_t votes;
  std::uint32_t query;  ///< keypoint of the frame

  Eigen::Vector2d from() const { return {map.from_x, map.from_y}; }  ///< px of the picture
  Eigen::Vector2d to() const { return {map.to_x, map.to_y}; }        ///< px of the frame
};

/// Makes seeds of the pairs of keypoints of one picture. Each pair predicts an affine map. It gets
/// a vote from each other pair that is near, lies where this map predicts, and has a similar map.
/// Keeps its buffers.
class Seeds {
 public:
  /// Collects pairs with the picture of `reference` from `begin` to `end`. `frames`: the keypoints
  /// of the frame. Those whose `taken` is not zero are left out; empty: none is.
  void collect(const IndexHit* begin, const IndexHit* end, const growth::ReferenceFrames& reference,
               const std::vector<growth::LocalFrame>& frames,
               const std::vector<std::uint8_t>& taken, std::int32_t fewest_votes);

  /// Seeds with `fewest_votes` or more, the ones with most votes first.
  const std::vector<Seed>& best() const { return seeds_; }
  /// Votes of the best one; 0 if there is none.
  std::int32_t votes() const { return seeds_.empty() ? 0 : seeds_.front().votes; }

 private:
  void vote(std::int32_t fewest_votes);

  const VoteKernel* kernel_ = &bestVoteKernel();
  std::vector<Seed> seeds_;
  std::vector<float> columns_;  // their maps, for the kernel: the first value of all, and so on
};

/// The affine map from picture to frame around the seed, fitted to those of `seeds` that vote for
/// it.
Eigen::Matrix3d affineOf(const Seed& seed, const std::vector<Seed>& seeds);

}  // namespace ktgp_orb::targets
