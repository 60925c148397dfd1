#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "ktgp_orb/sequence_matcher.h"

namespace ktgp_orb::sequence {

/// Predicts the position of the next frame: continues the motion between the last two frames at
/// constant velocity. Frames are identified by their addresses, which is safe because the sequence
/// holds the last frame and its reference.
class MotionPredictor {
 public:
  /// Predicted homography from `reference` to `next`. If the motion is not known, for example after
  /// a gap, assumes that there is none. Empty if the homography from `reference` to the last frame
  /// is not known.
  std::optional<Eigen::Matrix3d> predict(const Frame& reference, const Frame& next) const;

  /// Whether `result` has so few inliers, compared with the last frame, that the prediction is not
  /// to be trusted.
  bool isPoor(const MatchResult& result) const;

  /// Call this after `frame` was matched to `reference`.
  void advance(const Frame& frame, const Frame& reference, const MatchResult& result);
  /// Call this after a frame that was not matched.
  void restartAt(const Frame& frame);
  /// Replaces `frame` by `fresh`, a new frame of the same image.
  void replace(const Frame& frame, const Frame& fresh);
  void forget() { *this = {}; }

 private:
  std::optional<Eigen::Matrix3d> lastSeenFrom(const Frame& reference) const;

  const Frame* last_ = nullptr;
  const Frame* reference_ = nullptr;  // reference of the last frame, if its homography was found
  std::int64_t stamp_ = 0;            // stamp of the last frame
  Eigen::Matrix3d from_reference_ = Eigen::Matrix3d::Identity();
  std::size_t inliers_ = 0;
  std::optional<Eigen::Matrix3d> motion_;  // homography between the last two frames, if it is known
  std::int64_t duration_ = 0;              // time between the last two frames, ns
};

}  // namespace ktgp_orb::sequence
