#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "ktgp_orb/sequence_matcher.h"

namespace ktgp_orb::sequence {

/// Predicts the homography to the next frame, assuming that the motion between the last two frames
/// continues with constant velocity. Stores only the addresses of frames; this is safe, because the
/// sequence keeps the last frame and its reference.
class MotionPredictor {
 public:
  /// Predicts the homography from `reference` to `next`. If the motion is unknown, for example
  /// after a gap, assumes that there is none. Empty if the homography from `reference` to the last
  /// frame is unknown.
  std::optional<Eigen::Matrix3d> predict(const Frame& reference, const Frame& next) const;

  /// Returns true if the search near the prediction probably failed: `result` has no homography, or
  /// far fewer inliers than the last frame.
  bool isPoor(const MatchResult& result) const;

  /// Call this after each match of a `frame` to a `reference`.
  void advance(const Frame& frame, const Frame& reference, const MatchResult& result);
  /// Call this after each frame that had no reference. Forgets the motion.
  void restartAt(const Frame& frame);
  /// Replaces `frame` by `fresh`, a new frame of the same image.
  void replace(const Frame& frame, const Frame& fresh);
  void forget() { *this = {}; }

 private:
  std::optional<Eigen::Matrix3d> lastSeenFrom(const Frame& reference) const;

  const Frame* last_ = nullptr;
  const Frame* reference_ = nullptr;  // reference of the last frame; null if it did not match
  std::int64_t stamp_ = 0;            // stamp of the last frame, ns
  Eigen::Matrix3d from_reference_ = Eigen::Matrix3d::Identity();
  std::size_t inliers_ = 0;
  // Homography from the frame before the last frame to the last frame; empty: unknown.
  std::optional<Eigen::Matrix3d> motion_;
  std::int64_t duration_ = 0;  // time between the last two frames, ns
};

}  // namespace ktgp_orb::sequence
