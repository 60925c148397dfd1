#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <optional>
#include <vector>

#include "growth/local_frame.h"
#include "ktgp_orb/features.h"
#include "util/cell_grid.h"

namespace ktgp_orb::growth {

/// Tells whether a homography agrees with the details that exist once in a repetitive picture, such
/// as the words of a form or the labels of a circuit diagram.
///
/// A shift by one period maps each symbol to another copy of it. It may have more nearest
/// neighbours than any other shift, if the copies happen to be sampled at the same positions
/// between the pixels. But it maps a detail that exists once to a different detail. So we ask of
/// each single detail: is its counterpart more similar to it than everything else in its own
/// picture? A single detail is a keypoint that differs from every other place of its picture by at
/// least kSingle bits.
class SingleDetails {
 public:
  /// The features must stay valid during the calls of count().
  void setFrames(const Features& reference, const Features& target);

  /// How many single details have a target keypoint within 4 px of their predicted position, and
  /// how many of these are found, that is, more similar to it than to everything else in their
  /// picture.
  struct Count {
    double seen, found;
    double share() const { return found / std::max(seen, 1.0); }
    /// Returns true if the homography contradicts the single details: less one standard deviation,
    /// fewer than a tenth are found. Of a few details, one or two that are found are not enough.
    bool contradict() const;
    /// Returns true if the single details alone show that the homography is right: at least a
    /// fifth are found, less one standard deviation, with eight neighbouring details taken as one.
    bool settle() const;
  };

  /// Counts the single details that are found with `map` (reference to target, px). Returns an
  /// empty value if the picture is not repetitive, that is, if at least half of the keypoints are
  /// single details: then many of them are not found for other reasons, for example because the
  /// scene is not flat.
  std::optional<Count> count(const Eigen::Matrix3d& map);

 private:
  /// Hamming distance. The copies of one symbol in one picture differ by less: nine of ten
  /// keypoints on the symbols of drawn pages have a copy within 24 bits.
  static constexpr int kSingle = 30;
  static constexpr float kRadius = 4.F;  // px

  void prepare();
  int nearestElsewhere(std::size_t index);

  const Features* reference_ = nullptr;
  const Features* target_ = nullptr;
  bool is_prepared_ = false;  // few pairs need count(), so its buffers are filled when it is called
  std::vector<Bits> bits_, target_bits_;
  /// For each keypoint of the reference, the Hamming distance to the most similar keypoint
  /// elsewhere in the reference, 0 if it is below kSingle, or -1 if it is not known yet.
  std::vector<int> elsewhere_;
  util::CellGrid cells_;  // keypoints of the target
};

}  // namespace ktgp_orb::growth
