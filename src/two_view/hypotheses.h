#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include "two_view/epipolar.h"

namespace ktgp_orb::two_view {

/// A motion with a translation that may explain the pairs.
struct Hypothesis {
  Epipolar geometry;
  double gain = 0.0;            ///< see Hypotheses
  double probability = 0.0;     ///< among those in the list
  std::vector<double> gains{};  ///< gain of each pair
};

/// All motions that may explain the pairs, and their judge.
///
/// Every start is refined by the same fit over all pairs. The likelihood of a pair mixes Student's
/// t distribution of its distance (EpipolarPairs::distance, which has the chirality) with the
/// uniform one of wrong pairs; its logarithm over that of a wrong pair is the gain. The motion with
/// the largest sum explains the pairs best.
///
/// How surely depends on the pairs that tell two motions apart. Neighbouring pairs are not
/// independent: they may be on something that moves, or be mistaken in the same way. So the
/// difference of the sums is divided by the factor by which the variance of its parts, summed over
/// cells of the image, exceeds that of independent pairs (the design effect of cluster samples);
/// and no cell counts for more than `kMostOfACell`. A pair on the dominant plane, which agrees with
/// both motions of that plane, has no say where it is nearly indifferent: a thousand pairs with
/// smooth errors of a hundredth of a pixel would decide.
class Hypotheses {
 public:
  /// Stored by reference. `cell`, side of a cell, and `range`, over which the distances of wrong
  /// pairs are spread: normalised units. `found`: what the search found. `plane`: the dominant one,
  /// px; null: none.
  void load(const EpipolarPairs& pairs, double cell, double range, const Epipolar& found,
            const Eigen::Matrix3d* plane);

  /// Adds a start, of either sign, after some steps of its refinement.
  void start(const RelativePose& motion);
  /// Fits the best starts, and orders the different motions among them, best first.
  void refine();
  /// Judges these motions, as they are; the best of the others stays as a rival of the same
  /// probability at most.
  void prefer(const std::vector<RelativePose>& motions);
  void clear() { list_.clear(); }
  const std::vector<Hypothesis>& list() const { return list_; }
  /// Effective difference of log-likelihood between two motions; positive: a is better.
  double difference(const Hypothesis& a, const Hypothesis& b) const;

 private:
  void setGains(Hypothesis& hypothesis) const;
  void judge();
  bool isKnown(const Epipolar& geometry) const;

  const EpipolarPairs* pairs_ = nullptr;
  EpipolarFit fit_;
  double range_ = 1.0;
  double scale_ = 1.0;  // scale of the distances
  // Share of right pairs among the precise pairs [0] and among the others [1].
  double share_[2] = {0.5, 0.5};
  std::vector<std::size_t> cell_;  // cell of each pair
  std::vector<double> off_plane_;  // distance of each pair over its deviation
  mutable std::vector<double> cells_;
  std::vector<std::pair<float, Epipolar>> starts_;  // with their costs
  std::vector<Hypothesis> list_;
};

/// Angle between the directions, or of the turn between two motions, whichever is larger, rad.
double apart(const RelativePose& a, const RelativePose& b);

}  // namespace ktgp_orb::two_view
