#pragma once

#include <optional>

#include "core/homography/covariance.h"
#include "ktgp_orb/sequence_matcher.h"

namespace ktgp_orb::sequence {

/// Decides which frame the next one is matched to, when to forget it, and accumulates homographies.
class ReferenceKeeper {
 public:
  void setOptions(const ReferenceOptions& options);

  /// The frame to match `next` to, or null; reason() then says why. Forgets a reference that cannot
  /// belong to the same sequence. A fixed reference stays.
  FramePtr referenceFor(const Frame& next);
  NoReference reason() const { return reason_; }

  /// Keyframe mode, after `frame` was matched to the keyframe with `result`: the frame before, to
  /// match to as well, where the keyframe's support got weak; else null. Should that find a
  /// homography, it takes over, so that the chain of homographies does not break.
  FramePtr secondChoice(const Frame& frame, const MatchResult& result) const;

  /// After all matching of `frame`: `result` is that of the match to `reference`, which counts;
  /// null where there was no reference.
  void advance(const FramePtr& frame, const FramePtr& reference, const MatchResult* result);

  /// From the first frame of the unbroken sequence to the last one advanced to; nothing where the
  /// chain has just (re)started or in fixed mode.
  const std::optional<AccumulatedHomography>& accumulated() const { return accumulated_; }

  /// Makes `frame` the fixed reference; null: none.
  void setFixed(const FramePtr& frame) { fixed_ = frame; }
  const FramePtr& fixed() const { return fixed_; }
  /// `fresh` is the same image as `frame`, and a reference wherever that is one.
  void replace(const FramePtr& frame, const FramePtr& fresh);
  /// Forgets every reference but the fixed one.
  void forget(NoReference reason);

 private:
  NoReference whyNotAfterPrevious(const Frame& next) const;
  bool weak(const Frame& frame, const MatchResult& result) const;
  void restartAt(const FramePtr& frame);

  ReferenceOptions options_;
  FramePtr fixed_;
  FramePtr reference_;  // previous: the frame before; keyframe: the keyframe
  FramePtr previous_;   // the frame before, with an unbroken chain of homographies to it
  NoReference reason_ = NoReference::none;
  NoReference forgotten_ =
      NoReference::first_frame;  // why previous_ is null, until a frame is told
  // From the first frame of the sequence.
  std::int64_t first_stamp_ = 0;
  UncertainHomography to_reference_;
  UncertainHomography to_previous_;
  std::optional<AccumulatedHomography> accumulated_;
};

}  // namespace ktgp_orb::sequence
