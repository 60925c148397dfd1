#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>

namespace ktgp_orb {

/// Remembers how the newest frames of a camera map onto each other, from the homography of each to
/// its reference, whatever the reference is: the frame before, a keyframe, a fixed one.
///
/// Everything is kept relative to the newest frame, so that nothing grows however long the camera
/// flies. An instance belongs to one thread at a time.
class FramePath {
 public:
  /// Remembers `length` frames at most, >= 1, and beside them the reference of the newest.
  explicit FramePath(std::size_t length);

  /// Appends a frame. `homography`: reference -> frame, in px; nothing: none was found. Returns
  /// whether the frame is connected to the ones before; where it is not, those are forgotten.
  /// A reference that is not known starts a path of two frames: it and this one.
  bool add(std::int64_t stamp, std::int64_t reference_stamp,
           const std::optional<Eigen::Matrix3d>& homography);

  /// The homography frame `from` -> frame `to`; nothing where one of them is not remembered.
  std::optional<Eigen::Matrix3d> between(std::int64_t from, std::int64_t to) const;

  void clear();

  struct Step {
    std::int64_t stamp = 0;
    Eigen::Matrix3d to_newest = Eigen::Matrix3d::Identity();  ///< frame -> newest frame
  };
  /// Oldest first.
  const std::deque<Step>& steps() const { return steps_; }

 private:
  const Step* find(std::int64_t stamp) const;

  std::size_t length_;
  std::deque<Step> steps_;
  std::optional<Step> reference_;  // of the newest frame; it may be older than all the steps
};

}  // namespace ktgp_orb
