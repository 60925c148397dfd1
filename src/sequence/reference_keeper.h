#pragma once

#include <cstdint>
#include <optional>

#include "homography/transform.h"
#include "ktgp_orb/sequence_matcher.h"
#include "util/stamp_order.h"

namespace ktgp_orb::sequence {

/// The reason why two frames are not from the same camera: their encodings or their lenses differ.
/// Returns none if both are the same.
NoReference anotherCamera(const Frame& next, const Frame& before);

/// Chooses the reference of each frame and decides when to forget it. Multiplies the homographies
/// from frame to frame to get the homography from the first frame to the newest.
class ReferenceKeeper {
 public:
  void setOptions(const ReferenceOptions& options);

  /// Returns the reference frame for `next`. If it is null, reason() says why. Except in fixed
  /// mode, first forgets the reference if it cannot belong to the same sequence as `next`.
  FramePtr referenceFor(const Frame& next);
  NoReference reason() const { return reason_; }

  /// In keyframe mode, call this after `frame` was matched to the keyframe. `result`: this match.
  /// If it is weak (few inliers or little overlap), returns the previous frame as a second
  /// reference to try; otherwise null. If the match to the previous frame gives a homography, that
  /// frame becomes the keyframe, and the chain of homographies is not broken.
  FramePtr secondChoice(const Frame& frame, const MatchResult& result) const;

  /// Updates the reference and the chain of homographies after each frame. `result`: the final
  /// match of `frame` to `reference`; null if there was no reference.
  void advance(const FramePtr& frame, const FramePtr& reference, const MatchResult* result);

  /// Homography from the first frame of the sequence to the last frame: the product of the
  /// homographies in between. Empty in fixed mode, and if the last frame has begun a new sequence
  /// or its stamp is out of order.
  const std::optional<UncertainHomography>& accumulated() const { return accumulated_; }
  std::int64_t firstStamp() const { return first_stamp_; }

  /// Makes `frame` the reference of the fixed mode; null removes the reference.
  void setFixed(const FramePtr& frame) { fixed_ = frame; }
  const FramePtr& fixed() const { return fixed_; }
  /// Replaces `frame` by `fresh`, a new frame of the same image, wherever `frame` is a reference.
  void replace(const FramePtr& frame, const FramePtr& fresh);
  /// Forgets all references except the fixed one. `reason`: why the next frame has no reference.
  void forget(NoReference reason);

 private:
  NoReference outOfOrder(const Frame& next);
  NoReference whyNotAfterPrevious(const Frame& next) const;
  bool weak(const Frame& frame, const MatchResult& result) const;
  void restartAt(const FramePtr& frame);

  ReferenceOptions options_;
  FramePtr fixed_;
  FramePtr reference_;  // previous frame or keyframe, depending on the mode
  FramePtr previous_;   // previous frame; null if the chain of homographies is broken
  FramePtr apart_;      // newest frame if its stamp may be wrong (see StampOrder)
  util::StampOrder order_;
  NoReference reason_ = NoReference::none;
  NoReference forgotten_ = NoReference::first_frame;  // reason why previous_ is null
  // The next two homographies map from the first frame of the sequence.
  std::int64_t first_stamp_ = 0;
  UncertainHomography to_reference_{Eigen::Matrix3d::Identity()};
  UncertainHomography to_previous_{Eigen::Matrix3d::Identity()};
  std::optional<UncertainHomography> accumulated_;
};

}  // namespace ktgp_orb::sequence
