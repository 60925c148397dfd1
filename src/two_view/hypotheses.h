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
  double probability = 0.0;     ///< probability among all hypotheses of the list
  std::vector<double> gains{};  ///< gain of each pair
};

/// The motions that may explain the pairs, and their probabilities.
///
/// refine() fits the best of the motions passed to start(), each with the same fit over all pairs.
/// The likelihood of a pair is a mixture: Student's t distribution of its distance
/// (EpipolarPairs::distance, which includes the chirality) for right pairs, and a uniform
/// distribution for wrong pairs. The gain of a pair is log(L / L0), where L is its
/// likelihood and L0 is the likelihood of a wrong pair. The motion with the largest sum of gains
/// explains the pairs best.
///
/// The difference of two sums tells how much more likely one motion is, but neighbouring pairs are
/// not independent: they may be on a moving object, or be mismatched in the same way. So the
/// difference is divided by the design effect of cluster samples. This is the variance of the
/// difference computed from the cells of the image, divided by its variance for independent pairs.
/// No cell counts for more than `kMostOfACell`. A pair on the dominant plane agrees with both
/// motions of that plane, so it is left out if its two gains are nearly equal. Otherwise, smooth
/// errors of a hundredth of a pixel in a thousand such pairs would decide between the motions.
class Hypotheses {
 public:
  /// Keeps a pointer to `pairs`. `cell`: side of a cell; `range`: length over which the distances
  /// of wrong pairs are assumed to be uniform; both in normalised units. `found`: the motion that
  /// PROSAC found. `plane`: homography of the dominant plane, px; null if there is none.
  void load(const EpipolarPairs& pairs, double cell, double range, const Epipolar& found,
            const Eigen::Matrix3d* plane);

  /// Improves `motion` by a few steps of the fit, and adds it to the motions from which refine()
  /// starts. Before that, chooses the sign of its translation so that most points are in front of
  /// the cameras.
  void start(const RelativePose& motion);
  /// Fits the best of the motions that were passed to start(). Afterwards list() contains each
  /// fitted motion with both signs of its translation, without duplicates, best first.
  void refine();
  /// Replaces the list by `motions`, without refining them. If `motions` does not contain the best
  /// motion of the old list, this motion stays as a rival. It gets at most the probability of the
  /// best of `motions`.
  void prefer(const std::vector<RelativePose>& motions);
  /// How much better the best motion of the list explains the pairs than `motion`; see
  /// difference().
  double leadOver(const RelativePose& motion) const;
  void clear() { list_.clear(); }
  const std::vector<Hypothesis>& list() const { return list_; }
  /// Difference of the log-likelihoods of two motions, reduced as the comment of the class
  /// explains; positive if `a` is better.
  double difference(const Hypothesis& a, const Hypothesis& b) const;

 private:
  void setGains(Hypothesis& hypothesis) const;
  void judge();
  bool isKnown(const Epipolar& geometry) const;

  const EpipolarPairs* pairs_ = nullptr;
  EpipolarFit fit_;
  double range_ = 1.0;
  double scale_ = 1.0;  // scale of Student's t distribution, normalised units
  // Share of right pairs among the precise pairs (precision >= 1) [0] and among the others [1].
  double share_[2] = {0.5, 0.5};
  std::vector<std::size_t> cell_;  // cell of each pair
  std::vector<double> off_plane_;  // distance of each pair from the plane, times its precision
  mutable std::vector<double> cells_;
  std::vector<std::pair<float, Epipolar>> starts_;  // cost of each start, and the start
  std::vector<Hypothesis> list_;
};

}  // namespace ktgp_orb::two_view
