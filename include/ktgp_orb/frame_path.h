#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>

namespace ktgp_orb {

/// Stores the homographies between the newest frames of a camera. Computes them from the homography
/// between each frame and its reference, which may be the previous frame, a keyframe, or a fixed
/// frame.
///
/// All homographies are relative to the newest frame, so that their entries do not grow during a
/// long flight. An instance belongs to one thread at a time.
class FramePath {
 public:
  /// Keeps the newest `length` frames (at least one) and the reference of the newest frame.
  explicit FramePath(std::size_t length);

  /// Appends a frame. `homography`: reference -> frame, px; empty if none was found. Returns true
  /// if the frame is connected to the stored frames; otherwise the stored frames are forgotten. If
  /// the reference is not stored, a new path begins with the reference and this frame. If there is
  /// no usable homography, a new path begins with this frame alone.
  bool add(std::int64_t stamp, std::int64_t reference_stamp,
           const std::optional<Eigen::Matrix3d>& homography);

  /// The homography that maps frame `from` to frame `to`; empty if one of the frames is not stored.
  std::optional<Eigen::Matrix3d> between(std::int64_t from, std::int64_t to) const;

  /// True if the homography is finite and can be inverted; add() treats any other as missing.
  static bool isUsable(const Eigen::Matrix3d& homography);

  void clear();

  struct Step {
    std::int64_t stamp = 0;
    /// Homography frame -> newest frame, px.
    Eigen::Matrix3d to_newest = Eigen::Matrix3d::Identity();
  };
  /// The frames, oldest first.
  const std::deque<Step>& steps() const { return steps_; }

 private:
  const Step* find(std::int64_t stamp) const;

  std::size_t length_;
  std::deque<Step> steps_;
  std::optional<Step> reference_;  // reference of the newest frame; may be older than all steps
};

}  // namespace ktgp_orb
