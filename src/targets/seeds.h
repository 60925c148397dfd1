#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "growth/local_frame.h"
#include "growth/reference_frames.h"
#include "targets/target_index.h"
#include "targets/vote_kernel.h"

namespace ktgp_orb::targets {

/// A pair of keypoints from which a homography can grow, and the number of other pairs that agree
/// with this pair.
struct Seed {
  SeedMap map;
  std::int32_t votes;
  std::uint32_t query;  ///< number of the keypoint in the frame

  Eigen::Vector2d from() const { return {map.from_x, map.from_y}; }  ///< px of the picture
  Eigen::Vector2d to() const { return {map.to_x, map.to_y}; }        ///< px of the frame
};

/// Makes seeds from pairs of keypoints of one picture and the frame. Each pair predicts an affine
/// map from picture to frame, and gets a vote from each other pair that is near, lies at the place
/// that the map predicts, and has a similar map.
class Seeds {
 public:
  /// Makes seeds from the pairs in [begin, end), which must all belong to one picture. `reference`:
  /// keypoints of this picture. `frames`: keypoints of the frame. `taken`: non-zero for keypoints
  /// of the frame that must not be used; empty if all may be used. Drops seeds with fewer than
  /// `fewest_votes` votes.
  void collect(const IndexHit* begin, const IndexHit* end, const growth::ReferenceFrames& reference,
               const std::vector<growth::LocalFrame>& frames,
               const std::vector<std::uint8_t>& taken, std::int32_t fewest_votes);

  /// The seeds that are left, sorted by votes, most votes first.
  const std::vector<Seed>& best() const { return seeds_; }
  /// Votes of the best seed; 0 if there is no seed.
  std::int32_t votes() const { return seeds_.empty() ? 0 : seeds_.front().votes; }

 private:
  void vote(std::int32_t fewest_votes);

  const VoteKernel* kernel_ = &bestVoteKernel();
  std::vector<Seed> seeds_;
  std::vector<float> columns_;  // maps of the seeds for the vote kernel, one column per value
};

/// The affine map from picture to frame near the seed, fitted to the pairs that vote for the seed.
Eigen::Matrix3d affineOf(const Seed& seed, const std::vector<Seed>& seeds);

}  // namespace ktgp_orb::targets
