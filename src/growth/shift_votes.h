#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <opencv2/core/types.hpp>
#include <vector>

#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::growth {

/// Tells a homography from the same homography shifted to a place that looks alike, such as the
/// next window of a facade or the next symbol of a circuit diagram.
///
/// Thousands of keypoints near the predicted positions agree with either homography. Nearest
/// neighbours in the whole image are chosen among all copies, so only things that exist once keep
/// voting for the right shift. Each pair of mutual nearest neighbours votes for the shift between
/// its target point and the predicted point. Votes are compared as shares of the pairs that both
/// images could show at that shift, since a shift by one period also changes the overlap.
class ShiftVotes {
 public:
  struct Peak {
    Eigen::Vector2d shift{0.0, 0.0};   ///< px of the target
    Eigen::Vector2d centre{0.0, 0.0};  ///< centre of the voters, px of the reference
    double votes = 0.0;                ///< number of votes, one per 12x12 px of either image
    double seen = 0.0;                 ///< number of pairs that the target could show
    double share() const { return votes / (seen > 1.0 ? seen : 1.0); }
  };

  /// `map`: reference -> target. `pairs`: mutual nearest neighbours. `target`: size of the target.
  void count(const Eigen::Matrix3d& map, const PointPairs& pairs, const cv::Size& target);

  const Peak& own() const { return own_; }
  /// The other shifts with the most votes, at most 16.
  const std::vector<Peak>& others() const { return others_; }
  /// Whether another shift has at least half the share of votes of the own shift, both less one
  /// deviation. A shift with fewer than eight votes is due to chance.
  bool isRivalled() const;

 private:
  struct Vote {
    Eigen::Vector2d shift, from, to;
  };
  template <typename Visit>
  void visitNear(const Eigen::Vector2d& shift, Visit visit) const;
  Peak peakAt(const Eigen::Vector2d& shift, const cv::Size& target);
  void findOthers(const cv::Size& target);

  std::vector<Vote> votes_;  // sorted by the shift's x
  Peak own_;
  std::vector<Peak> others_;
  std::vector<std::size_t> near_;                      // for each vote, the number of votes near it
  std::vector<std::size_t> order_;                     // order of votes_, the most crowded first
  std::array<std::vector<std::uint64_t>, 2> cells_{};  // cells of the voters, in either image
};

}  // namespace ktgp_orb::growth
