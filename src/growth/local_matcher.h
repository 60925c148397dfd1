#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <opencv2/core/types.hpp>
#include <vector>

#include "growth/alike_kernel.h"
#include "growth/local_frame.h"
#include "ktgp_orb/features.h"
#include "util/cell_grid.h"

namespace ktgp_orb::growth {

/// A keypoint of the reference, mapped into the target.
struct Prediction {
  LocalFrame frame;
  std::int32_t reference;
};

struct LocalMatch {
  std::int32_t reference;
  std::int32_t target;
  std::int32_t distance;  ///< Hamming distance
  float squared_error;    ///< squared distance from the predicted position, px²
};

/// Matches keypoints of the reference to target keypoints near their predicted positions, with the
/// predicted direction and size. Reuses its buffers from call to call.
class LocalMatcher {
 public:
  static constexpr int kMaxDistance = 80;

  void setTarget(const Features& target);

  /// Finds the mutual nearest pairs whose target keypoint is within `radius` px of the predicted
  /// position moved by `shift`. Directions must differ by less than 0.6 rad and sizes by a factor
  /// of less than 1.8, and the Hamming distance must be at most kMaxDistance. At equal distances
  /// the lower index wins. Matches are in the order of the predictions. Returns the number of
  /// predictions with any keypoint within the radius.
  std::size_t match(const std::vector<Prediction>& predictions, const std::vector<Bits>& reference,
                    const cv::Point2f& shift, float radius, std::vector<LocalMatch>& matches);

  /// Calls visit(dx, dy, descriptor) for each target keypoint near `wanted` whose direction and
  /// size are similar to `wanted`, as in match(). dx, dy: offset of the keypoint from `wanted`, px.
  /// Visits all keypoints with |dx| and |dy| up to `radius`, and a few that are up to a cell
  /// (kCell) farther away.
  template <typename Visit>
  void visitAlike(const LocalFrame& wanted, float radius, Visit visit) const {
    cells_.visitRuns(wanted.x, wanted.y, radius, [&](std::uint32_t begin, std::uint32_t end) {
      for (std::uint32_t i = begin; i < end; ++i) {
        const LocalFrame& frame = frames_[i];
        const bool turns_alike = frame.dx * wanted.dx + frame.dy * wanted.dy >= kAlikeCosine;
        const bool scales_alike = std::abs(frame.log_size - wanted.log_size) <= kAlikeLogScale;
        if (turns_alike & scales_alike) visit(frame.x - wanted.x, frame.y - wanted.y, bits_[i]);
      }
    });
  }

  /// Number of pairs that passed the tests of position, direction, size and Hamming distance in the
  /// last match(), whether mutual or not.
  std::size_t candidates() const { return candidates_; }

  const LocalFrame& frame(std::int32_t target) const {
    return frames_[position_[static_cast<std::size_t>(target)]];
  }
  std::size_t size() const { return frames_.size(); }
  const cv::Size& imageSize() const { return image_size_; }

 private:
  static constexpr float kCell = 8.F;  // px

  std::int64_t nearest(std::int32_t index, const Bits& bits, std::size_t count,
                       std::uint32_t& place);

  const AlikeKernel* kernel_ = &bestAlikeKernel();
  util::CellGrid cells_;
  cv::Size image_size_;
  // frames_, columns_ and bits_ are sorted by the cell of the keypoint.
  std::vector<LocalFrame> frames_;
  // The fields of frames_ in columns, for the kernel: first x of all keypoints, then y of all
  // keypoints, and so on.
  std::vector<float> columns_;
  std::size_t pitch_ = 0;  // distance from one column to the next, in floats
  std::vector<Bits> bits_;
  std::vector<std::uint32_t> position_;  // index in frames_ of each target keypoint
  // For each entry of frames_, the key (distance and number, see key()) of the prediction with the
  // most similar descriptor.
  std::vector<std::int64_t> best_reference_;
  std::vector<std::uint32_t> alike_;
  std::size_t candidates_ = 0;
};

}  // namespace ktgp_orb::growth
