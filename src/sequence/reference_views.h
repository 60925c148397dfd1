#pragma once

#include <future>

#include "ktgp_orb/growth.h"
#include "ktgp_orb/sequence_matcher.h"

namespace ktgp_orb::sequence {

/// The simulated views of one reference. They take seconds where it is large, so a caller who
/// cannot wait has them made in a thread of its own, one reference at a time.
class ReferenceViewsMaker {
 public:
  /// The views of `reference`, which has an image. Null while they are made in the background.
  const ReferenceViews* of(const FramePtr& reference, const OrbOptions& orb, int views,
                           bool in_background);
  /// The options have changed, or the reference: other views are wanted from now on.
  void forget();
  /// As of the last call of of().
  ViewsState state() const { return state_; }

 private:
  bool takeFinished(const FramePtr& reference);

  ReferenceViews views_;
  FramePtr viewed_;  // the frame of views_; null: they are of no use
  ViewsState state_ = ViewsState::none;
  FramePtr in_work_;                  // owns the pixels that the thread reads
  bool is_wanted_ = false;            // what the thread makes is still wanted
  std::future<ReferenceViews> work_;  // last: its destructor waits for the thread
};

}  // namespace ktgp_orb::sequence
