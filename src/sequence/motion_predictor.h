#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "ktgp_orb/sequence_matcher.h"

namespace ktgp_orb::sequence {

/// Predicts the next frame: continues the motion between the last two frames at constant velocity.
/// Frames are identified by their addresses: the sequence holds the last frame and its reference.
class MotionPredictor {
 public:
  /// Predicted homography from `reference` to `next`. Assumes no motion if it is not known, for
  /// example after a gap. Empty if the last frame's position seen from `reference` is not known.
  std::optional<Eigen::Matrix3d> predict(const Frame& reference, const Frame& next) const;

  /// Whether `result` has too few inliers, compared with the last frame, to trust the prediction.
  bool isPoor(const MatchResult& result) const;

  /// Call it after `frame` was matched to `reference`.
  void advance(const Frame& frame, const Frame& reference, const MatchResult& result);
  /// Call it after a frame that was not matched.
  void restartAt(const Frame& frame);
  /// `fresh` is a new frame of the same image and replaces `frame`.
  void replace(const Frame& frame, const Frame& fresh);
  void forget() { *this = {}; }

 private:
  std::optional<Eigen::Matrix3d> lastSeenFrom(const Frame& reference) const;

  const Frame* last_ = nullptr;
  const Frame* reference_ = nullptr;  // reference of the last frame, if its homography was found
  std::int64_t stamp_ = 0;            // stamp of the last frame
  Eigen::Matrix3d from_reference_ = Eigen::Matrix3d::Identity();
  std::size_t inliers_ = 0;
  std::optional<Eigen::Matrix3d> motion_;  // between the last two frames
  std::int64_t duration_ = 0;              // duration of this motion, ns
};

}  // namespace ktgp_orb::sequence
