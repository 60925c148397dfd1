#include "sequence/reference_views.h"

#include <chrono>
#include <utility>

namespace ktgp_orb::sequence {

const ReferenceViews* ReferenceViewsMaker::of(const FramePtr& reference, const OrbOptions& orb,
                                              int views, bool in_background) {
  if (viewed_ == reference || takeFinished(reference)) return &views_;
  viewed_.reset();
  views_ = {};  // saves memory: free the old views before new ones are made
  if (!in_background) {
    views_ = simulateViews(reference->image, orb, views);
    viewed_ = reference;
    state_ = ViewsState::ready;
    return &views_;
  }
  state_ = ViewsState::being_made;
  if (!work_.valid()) {
    in_work_ = reference;
    is_wanted_ = true;
    work_ = std::async(std::launch::async, [image = reference->image, orb, views] {
      return simulateViews(image, orb, views);
    });
  }
  return nullptr;
}

/// If the thread has finished, takes over its views. Returns true if they belong to `reference` and
/// are still wanted.
bool ReferenceViewsMaker::takeFinished(const FramePtr& reference) {
  if (!work_.valid() || work_.wait_for(std::chrono::seconds(0)) != std::future_status::ready) {
    return false;
  }
  const FramePtr of_work = std::exchange(in_work_, nullptr);
  ReferenceViews made = work_.get();
  if (!is_wanted_ || of_work != reference) return false;
  views_ = std::move(made);
  viewed_ = of_work;
  state_ = ViewsState::ready;
  return true;
}

void ReferenceViewsMaker::forget() {
  viewed_.reset();
  is_wanted_ = false;
  state_ = ViewsState::none;
}

}  // namespace ktgp_orb::sequence
