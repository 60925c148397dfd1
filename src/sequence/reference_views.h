#pragma once

#include <future>

#include "ktgp_orb/growth.h"
#include "ktgp_orb/sequence_matcher.h"

namespace ktgp_orb::sequence {

/// Makes the simulated views of a reference. For a large reference this takes seconds, so a caller
/// who cannot wait has them made in a background thread, one reference at a time.
class ReferenceViewsMaker {
 public:
  /// The views of `reference`, which must have an image; null while they are made in background.
  const ReferenceViews* of(const FramePtr& reference, const OrbOptions& orb, int views,
                           bool in_background);
  /// Discards the views, also the views that are being made. Call this if the options or the
  /// reference have changed.
  void forget();
  /// State after the last call of of() or forget().
  ViewsState state() const { return state_; }

 private:
  bool takeFinished(const FramePtr& reference);

  ReferenceViews views_;
  FramePtr viewed_;  // the frame to which views_ belongs; null if views_ is not valid
  ViewsState state_ = ViewsState::none;
  FramePtr in_work_;                  // the frame whose pixels the thread reads
  bool is_wanted_ = false;            // whether the result of the thread is wanted
  std::future<ReferenceViews> work_;  // must be last: its destructor waits for the thread
};

}  // namespace ktgp_orb::sequence
