#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>

#include "ktgp_orb/sequence_matcher.h"

namespace ktgp_orb::sequence {

/// Where the next frame will be: the motion between the last two, carried on at constant velocity.
/// Frames are told apart by their addresses: the sequence holds on to the last frame and its
/// reference.
class MotionPredictor {
 public:
  /// From `reference` to `next`. The motion is none where it is not known, after a gap for example;
  /// nothing where it is not even known where the last frame was, seen from `reference`.
  std::optional<Eigen::Matrix3d> predict(const Frame& reference, const Frame& next) const;

  /// Whether `result` keeps so few of the last frame's inliers that the prediction is in doubt.
  bool isPoor(const MatchResult& result) const;

  /// After `frame` was matched to `reference`.
  void advance(const Frame& frame, const Frame& reference, const MatchResult& result);
  /// After a frame that was matched to nothing.
  void restartAt(const Frame& frame);
  /// `fresh` is the same image as `frame`, and stands in its place from now on.
  void replace(const Frame& frame, const Frame& fresh);
  void forget() { *this = {}; }

 private:
  std::optional<Eigen::Matrix3d> lastSeenFrom(const Frame& reference) const;

  const Frame* last_ = nullptr;
  const Frame* reference_ = nullptr;  // of the last frame, where it found its homography
  std::int64_t stamp_ = 0;            // of the last frame
  Eigen::Matrix3d from_reference_ = Eigen::Matrix3d::Identity();
  std::size_t inliers_ = 0;
  std::optional<Eigen::Matrix3d> motion_;  // between the last two frames
  std::int64_t duration_ = 0;              // of this motion, ns
};

}  // namespace ktgp_orb::sequence
