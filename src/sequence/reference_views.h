#pragma once

#include <future>

#include "ktgp_orb/growth.h"
#include "ktgp_orb/sequence_matcher.h"

namespace ktgp_orb::sequence {

/// Makes the simulated views of a reference (see simulateViews). For a large reference this takes
/// seconds. If the caller cannot wait, a background thread makes them, for one reference at a time.
class ReferenceViewsMaker {
 public:
  /// Returns the views of `reference`, which must have an image. With `in_background`, returns null
  /// until the background thread has finished them.
  const ReferenceViews* of(const FramePtr& reference, const OrbOptions& orb, int views,
                           bool in_background);
  /// Discards the views, including the views that the background thread is making. Call this if the
  /// options or the reference have changed.
  void forget();
  /// State of the views (none, being made or ready) after the last call of of() or forget().
  ViewsState state() const { return state_; }

 private:
  bool takeFinished(const FramePtr& reference);

  ReferenceViews views_;
  FramePtr viewed_;  // frame that views_ belongs to; null: views_ is invalid
  ViewsState state_ = ViewsState::none;
  FramePtr in_work_;                  // frame that the thread works on
  bool is_wanted_ = false;            // false: ignore the thread's result
  std::future<ReferenceViews> work_;  // must be last: its destructor waits for the thread
};

}  // namespace ktgp_orb::sequence
