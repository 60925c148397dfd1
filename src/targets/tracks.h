#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "targets/frame_search.h"

namespace ktgp_orb::targets {

/// An instance of a target that was seen in one of the last frames.
struct Track {
  const StoredTarget* target = nullptr;
  std::uint32_t picture = 0;
  int instance = 0;
  int age = 0;     ///< number of successive frames in which the instance was seen
  int unseen = 0;  ///< number of frames since the instance was last seen
  /// homography from the picture's `image` to the frame, px
  Eigen::Matrix3d map = Eigen::Matrix3d::Identity();
  Eigen::Vector2d middle = Eigen::Vector2d::Zero();    ///< centre of the picture in the frame, px
  Eigen::Vector2d velocity = Eigen::Vector2d::Zero();  ///< velocity of the centre, px per frame
  double extent = 0.0;                                 ///< half of the longer side in the frame, px
  bool is_matched = false;                             ///< the track has a detection in this frame
};

/// Gives each instance of a target a number that stays the same while the instance is followed.
class Tracks {
 public:
  /// Converts all tracks to px of the next searched frame. `scale`: its size divided by the size of
  /// the original frame.
  void setScale(double scale);
  /// Returns true if the next frame should be enlarged: if no instance is followed, if an instance
  /// was lost, or if the longer side of an instance is below 1.5 times `side` (px of the original
  /// frame).
  bool needsLargerFrame(double side) const;
  /// Call it before each frame.
  void beginFrame();
  /// Assigns each detection to the nearest track of the same target, if their distance is below the
  /// extent of the target, or else to a new track with the lowest free number. The nearest pairs
  /// are assigned first, so pass all detections at once. Appends the track of each detection to
  /// `tracks`, in the order of `found`.
  void assign(const std::vector<FoundTarget>& found, TargetStore& store,
              std::vector<Track>& tracks);
  /// Call it after each frame: forgets instances that were not seen for kMostUnseen frames.
  void endFrame();

  /// Tracks whose instance was seen in the last frame but has no detection in this frame so far.
  std::vector<Track> missing() const;
  bool wasSeen(const StoredTarget& target) const;
  void forget(const StoredTarget& target);
  void clear() { tracks_.clear(); }

  static constexpr int kMostUnseen = 30;

 private:
  int freeNumber(const StoredTarget& target) const;

  std::vector<Track> tracks_;
  double scale_ = 1.0;
};

/// The predicted homography from the picture's `image` to the next frame, px.
Eigen::Matrix3d predicted(const Track& track);

}  // namespace ktgp_orb::targets
