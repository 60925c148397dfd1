#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <opencv2/core/types.hpp>
#include <vector>

#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::growth {

/// Distinguishes the right homography from a copy of it that is shifted to a similar-looking place,
/// such as the next window of a facade or the next symbol of a circuit diagram.
///
/// With either homography, thousands of keypoints have a match near their predicted positions, so
/// these matches do not show which one is right. Instead we let nearest neighbours in the whole
/// image vote: each pair of mutual nearest neighbours votes for the shift from the predicted point
/// to its target point. The nearest neighbour of a keypoint may be in any copy of a pattern, so
/// patterns that repeat vote for many shifts, but patterns that occur only once vote for the right
/// shift. A shift by one period also changes the overlap of the images. So the votes of each shift
/// are divided by the number of pairs that both images could show at this shift.
class ShiftVotes {
 public:
  /// A shift that several pairs vote for.
  struct Peak {
    Eigen::Vector2d shift{0.0, 0.0};   ///< shift of the predicted points, px of the target
    Eigen::Vector2d centre{0.0, 0.0};  ///< centre of the voters, px of the reference
    double votes = 0.0;  ///< number of votes, at most one per 12x12 px of either image
    double seen = 0.0;   ///< number of pairs whose predicted point plus `shift` is in the target
    double share() const { return votes / (seen > 1.0 ? seen : 1.0); }
  };

  /// Counts the votes. `map`: homography from the reference to the target. `pairs`: the mutual
  /// nearest neighbours that vote. `target`: size of the target, px.
  void count(const Eigen::Matrix3d& map, const PointPairs& pairs, const cv::Size& target);

  /// The votes for `map` itself, that is, for the shift {0, 0}. We call it the own shift.
  const Peak& own() const { return own_; }
  /// The shifts with the most votes except the own shift {0, 0}, at most 16.
  const std::vector<Peak>& others() const { return others_; }
  /// Returns true if another shift has more than half the share of votes that the own shift has,
  /// after the votes of both were reduced by one standard deviation. A shift with fewer than eight
  /// votes is ignored, because it may be due to chance.
  bool isRivalled() const;
  /// Returns true if the own shift has at least eight votes, and significantly more than the other
  /// shifts: it is very unlikely (10^-5) to get so many votes with a share as large as the largest
  /// share of another shift, reduced by one standard deviation.
  bool standsOut() const;
  /// Returns true if the own shift has significantly more votes than the other shifts, as in
  /// standsOut(), or if no other shift has more than a few votes.
  bool isClear() const;
  /// Returns true if the own shift has at least eight votes.
  bool isEvident() const;
  /// Returns true if another shift has at least eight votes. Then the scene probably repeats
  /// itself.
  bool isRepetitive() const;

 private:
  /// The vote of one pair, and its points in the reference (`from`) and in the target (`to`), px.
  struct Vote {
    Eigen::Vector2d shift, from, to;
  };
  template <typename Visit>
  void visitNear(const Eigen::Vector2d& shift, Visit visit) const;
  Peak peakAt(const Eigen::Vector2d& shift, const cv::Size& target);
  void findOthers(const cv::Size& target);

  std::vector<Vote> votes_;  // sorted by the x coordinate of the shift
  Peak own_;
  std::vector<Peak> others_;
  std::vector<std::size_t> near_;  // number of votes near each vote
  // Indices into votes_, sorted by near_, the largest number first.
  std::vector<std::size_t> order_;
  // Buffers of peakAt(): cells of the voters in the reference [0] and in the target [1].
  std::array<std::vector<std::uint64_t>, 2> cells_{};
};

}  // namespace ktgp_orb::growth
