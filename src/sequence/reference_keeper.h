#pragma once

#include <cstdint>
#include <optional>

#include "homography/transform.h"
#include "ktgp_orb/sequence_matcher.h"
#include "util/stamp_order.h"

namespace ktgp_orb::sequence {

/// Why two frames cannot be from the same camera: their encodings or their lenses differ. Returns
/// none if there is no such difference.
NoReference anotherCamera(const Frame& next, const Frame& before);

/// Chooses the reference of the next frame, decides when to forget it, and accumulates
/// homographies.
class ReferenceKeeper {
 public:
  void setOptions(const ReferenceOptions& options);

  /// The reference frame for `next`. If it is null, reason() says why. Forgets a reference that
  /// cannot belong to the same sequence as `next`, unless it is the fixed reference.
  FramePtr referenceFor(const Frame& next);
  NoReference reason() const { return reason_; }

  /// Call this in keyframe mode after `frame` was matched to the keyframe with `result`. Returns
  /// the previous frame as a second reference if the keyframe has become weak, otherwise null. If
  /// the match to the previous frame then gives a homography, the previous frame becomes the
  /// keyframe, and the chain of homographies continues.
  FramePtr secondChoice(const Frame& frame, const MatchResult& result) const;

  /// Updates the reference and the chain of homographies after `frame` has been matched. `result`:
  /// the final match, which is a match to `reference`; null if there was no reference.
  void advance(const FramePtr& frame, const FramePtr& reference, const MatchResult* result);

  /// Homography from the first frame of the unbroken sequence to the last frame. Empty in fixed
  /// mode, and when a chain has just begun.
  const std::optional<UncertainHomography>& accumulated() const { return accumulated_; }
  std::int64_t firstStamp() const { return first_stamp_; }

  /// Makes `frame` the fixed reference. If it is null, there is no fixed reference.
  void setFixed(const FramePtr& frame) { fixed_ = frame; }
  const FramePtr& fixed() const { return fixed_; }
  /// Replaces the reference `frame` by `fresh`, a new frame of the same image.
  void replace(const FramePtr& frame, const FramePtr& fresh);
  /// Forgets every reference except the fixed one.
  void forget(NoReference reason);

 private:
  NoReference outOfOrder(const Frame& next);
  NoReference whyNotAfterPrevious(const Frame& next) const;
  bool weak(const Frame& frame, const MatchResult& result) const;
  void restartAt(const FramePtr& frame);

  ReferenceOptions options_;
  FramePtr fixed_;
  FramePtr reference_;  // the previous frame or the keyframe, depending on the mode
  FramePtr previous_;   // the previous frame, if the chain of homographies to it is unbroken
  FramePtr apart_;      // the newest frame, if its stamp is out of order and may be wrong
  util::StampOrder order_;
  NoReference reason_ = NoReference::none;
  NoReference forgotten_ = NoReference::first_frame;  // why previous_ is null
  // The homographies below map from the first frame of the sequence.
  std::int64_t first_stamp_ = 0;
  UncertainHomography to_reference_{Eigen::Matrix3d::Identity()};
  UncertainHomography to_previous_{Eigen::Matrix3d::Identity()};
  std::optional<UncertainHomography> accumulated_;
};

}  // namespace ktgp_orb::sequence
