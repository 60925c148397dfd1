#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>

namespace ktgp_orb::targets {

/// A pair of keypoints and the affine map that it predicts. The votes depend on nothing else.
struct SeedMap {
  float from_x, from_y;  ///< px of the picture
  float to_x, to_y;      ///< px of the frame
  float log_area;        ///< natural logarithm of the factor by which the map scales areas
  float xx, xy, yx, yy;  ///< linear part of the map, row by row
  float norm;            ///< Frobenius norm of the linear part
};
constexpr std::size_t kSeedMapValues = 10;
/// Each column of SeedMaps needs this many more floats after its last seed, because the kernels may
/// read beyond the seed.
constexpr std::size_t kReadBeyond = 16;

constexpr float kVoteReach = 150.F;  ///< largest distance between voter and seed, px of the picture
/// Minimum distance of a voter from the seed, px of the picture; nearer keypoints may show the same
/// corner.
constexpr float kVoteApart = 8.F;
constexpr float kVoteCosine = 0.85F;  ///< minimum cosine of the angle between both linear parts
/// Largest difference between the log_area of both maps: a factor of 1.6 in length.
constexpr float kVoteLogArea = 0.94F;
constexpr float kVoteSlack = 4.F;  ///< allowed error of the predicted place, px of the frame
/// Allowed error, as a share of the predicted distance from the seed in the frame; added in
/// quadrature to kVoteSlack.
constexpr float kVoteRelativeSlack = 0.25F;

/// Returns true if `voter` is near `seed`, lies at the place that the map of `seed` predicts, and
/// has a similar map.
inline bool agrees(const SeedMap& voter, const SeedMap& seed) {
  const float x = voter.from_x - seed.from_x;
  const float y = voter.from_y - seed.from_y;
  const float squared = x * x + y * y;
  if (squared > kVoteReach * kVoteReach || squared < kVoteApart * kVoteApart) return false;
  if (std::abs(voter.log_area - seed.log_area) > kVoteLogArea) return false;
  const float to_x = voter.to_x - seed.to_x;
  const float to_y = voter.to_y - seed.to_y;
  if (to_x * to_x + to_y * to_y < 0.25F * kVoteApart * kVoteApart) return false;
  const float there_x = seed.xx * x + seed.xy * y;
  const float there_y = seed.yx * x + seed.yy * y;
  const float error_x = to_x - there_x;
  const float error_y = to_y - there_y;
  const float slack = kVoteSlack * kVoteSlack + kVoteRelativeSlack * kVoteRelativeSlack *
                                                    (there_x * there_x + there_y * there_y);
  if (error_x * error_x + error_y * error_y > slack) return false;
  const float product =
      voter.xx * seed.xx + voter.xy * seed.xy + voter.yx * seed.yx + voter.yy * seed.yy;
  return product > kVoteCosine * voter.norm * seed.norm;
}

/// The loop that counts the votes for a seed, compiled for one instruction set. All kernels give
/// the same numbers.
struct VoteKernel {
  const char* name;  ///< instruction set, e.g. "AVX2"

  /// Counts how many of `count` voters agree with the seed. `columns`: the SeedMaps of the voters,
  /// one column per value. The column of the next value begins `pitch` floats later.
  std::int32_t (*votes)(const float* columns, std::size_t pitch, std::size_t count,
                        const SeedMap& seed);
};

/// Plain C++, the reference for the other kernels.
const VoteKernel& portableVoteKernel();
/// The fastest kernel that this build and this processor support.
const VoteKernel& bestVoteKernel();

}  // namespace ktgp_orb::targets
