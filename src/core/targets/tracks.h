#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "core/targets/frame_search.h"

namespace ktgp_orb::targets {

/// An instance of a target that was seen lately.
struct Track {
  const StoredTarget* target = nullptr;
  std::uint32_t picture = 0;
  int instance = 0;
  int age = 0;     ///< frames in which it was seen one after the other
  int unseen = 0;  ///< frames since then
  Eigen::Matrix3d map = Eigen::Matrix3d::Identity();   ///< picture's `image` -> frame, px
  Eigen::Vector2d middle = Eigen::Vector2d::Zero();    ///< of the picture in the frame, px
  Eigen::Vector2d velocity = Eigen::Vector2d::Zero();  ///< of this, px per frame
  double extent = 0.0;                                 ///< half of the longer side in the frame, px
  bool is_matched = false;                             ///< in this frame
};

/// Gives the instances of a target numbers that stay.
class Tracks {
 public:
  /// Before a frame.
  void beginFrame();
  /// The track of a detection: the nearest one of the same target, within its extent; or a new one
  /// with the lowest free number. Call it for many detections at once: the nearest pairs count
  /// first. Appends the tracks in their order.
  void assign(const std::vector<FoundTarget>& found, TargetStore& store,
              std::vector<Track>& tracks);
  /// After a frame: forgets what was not seen for kMostUnseen frames.
  void endFrame();

  /// Seen in the last frame, and not matched in this one so far.
  std::vector<Track> missing() const;
  bool wasSeen(const StoredTarget& target) const;
  void forget(const StoredTarget& target);
  void clear() { tracks_.clear(); }

  static constexpr int kMostUnseen = 30;

 private:
  int freeNumber(const StoredTarget& target) const;

  std::vector<Track> tracks_;
};

/// Where the picture is expected in the next frame.
Eigen::Matrix3d predicted(const Track& track);

}  // namespace ktgp_orb::targets
