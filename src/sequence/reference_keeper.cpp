#include "sequence/reference_keeper.h"

#include <algorithm>
#include <utility>

namespace ktgp_orb::sequence {

void ReferenceKeeper::setOptions(const ReferenceOptions& options) {
  if (options.mode != options_.mode) forget(NoReference::mode_changed);
  options_ = options;
}

FramePtr ReferenceKeeper::referenceFor(const Frame& next) {
  reason_ = NoReference::none;
  if (options_.mode == ReferenceMode::fixed) {
    if (!fixed_) reason_ = NoReference::not_set;
    return fixed_;
  }
  reason_ = outOfOrder(next);
  if (reason_ != NoReference::none) return nullptr;
  if (previous_) {
    const NoReference why = whyNotAfterPrevious(next);
    if (why != NoReference::none) forget(why);
  }
  if (!previous_) {
    order_ = {};
    order_.next(next.stamp);
    reason_ = forgotten_;
  }
  return reference_;
}

/// Returns gap or stamp_went_back if the stamp of `next` does not continue the sequence; otherwise
/// none. The previous frame must not be older than max_age; a keyframe may be older if frames keep
/// arriving. If the stamp of the previous frame turns out to be wrong (too late), that frame stays
/// the reference, because its image is right.
NoReference ReferenceKeeper::outOfOrder(const Frame& next) {
  if (!previous_) return NoReference::none;
  constexpr double kMost = 9e18;  // ns
  const auto longest = static_cast<std::uint64_t>(std::min(1e9 * options_.max_age, kMost));
  const util::StampOrder::Place place = order_.next(next.stamp, longest);
  if (place.restarted && apart_) restartAt(std::exchange(apart_, nullptr));
  if (!place.is_apart) return NoReference::none;
  return next.stamp < previous_->stamp ? NoReference::stamp_went_back : NoReference::gap;
}

NoReference anotherCamera(const Frame& next, const Frame& before) {
  if (next.encoding != before.encoding) return NoReference::encoding_changed;
  // Compare the calibrations of the lenses, because a caller may create a new lens object with the
  // same calibration for every frame.
  const LensConstPtr& lens = before.lens;
  const bool same_lens =
      next.lens == lens || (next.lens && lens && next.lens->calibration() == lens->calibration());
  return same_lens ? NoReference::none : NoReference::lens_changed;
}

NoReference ReferenceKeeper::whyNotAfterPrevious(const Frame& next) const {
  if (next.features.image_size != previous_->features.image_size) return NoReference::size_changed;
  // Without an image, a frame keeps its descriptors.
  for (const FramePtr& before : {previous_, reference_}) {
    const bool stay = next.image.empty() || before->image.empty();
    if (stay && next.features.descriptor != before->features.descriptor) {
      return NoReference::encoding_changed;
    }
  }
  return anotherCamera(next, *previous_);
}

bool ReferenceKeeper::weak(const Frame& frame, const MatchResult& result) const {
  if (result.homographyStatus() != Status::ok) return true;
  return result.inliers < static_cast<std::size_t>(options_.min_inliers) ||
         homography::overlap(result.answer.homography, frame.features.image_size) <
             options_.min_overlap;
}

FramePtr ReferenceKeeper::secondChoice(const Frame& frame, const MatchResult& result) const {
  const bool another = options_.mode == ReferenceMode::keyframe && reference_ != previous_;
  return another && weak(frame, result) ? previous_ : nullptr;
}

void ReferenceKeeper::advance(const FramePtr& frame, const FramePtr& reference,
                              const MatchResult* result) {
  forgotten_ = NoReference::none;
  if (options_.mode == ReferenceMode::fixed) return;
  const bool is_apart = reason_ == NoReference::stamp_went_back || reason_ == NoReference::gap;
  apart_ = is_apart ? frame : nullptr;
  if (apart_) {
    accumulated_.reset();
    return;
  }
  if (result == nullptr || result->homographyStatus() != Status::ok) {
    restartAt(frame);
    return;
  }
  const bool adjacent = reference == previous_;
  if (adjacent) {
    reference_ = previous_;
    to_reference_ = to_previous_;
  }
  to_previous_ = homography::chained(result->answer, to_reference_);
  accumulated_ = to_previous_;
  previous_ = frame;
  // In previous mode, the newest frame is always the next reference. In keyframe mode, it becomes
  // the keyframe if even two successive frames have few matches: an older keyframe would have still
  // fewer.
  if (options_.mode == ReferenceMode::previous || (adjacent && weak(*frame, *result))) {
    reference_ = previous_;
    to_reference_ = to_previous_;
  }
}

void ReferenceKeeper::restartAt(const FramePtr& frame) {
  reference_ = previous_ = frame;
  first_stamp_ = frame->stamp;
  to_reference_ = to_previous_ = {Eigen::Matrix3d::Identity()};
  accumulated_.reset();
}

void ReferenceKeeper::replace(const FramePtr& frame, const FramePtr& fresh) {
  for (FramePtr* held : {&fixed_, &reference_, &previous_, &apart_}) {
    if (*held == frame) *held = fresh;
  }
}

void ReferenceKeeper::forget(NoReference reason) {
  // If the user asked for a reset, report this. Otherwise, report the first of several reasons.
  const bool asked_for = reason == NoReference::first_frame || reason == NoReference::reset;
  if (asked_for || forgotten_ == NoReference::none) forgotten_ = reason;
  reference_.reset();
  previous_.reset();
  apart_.reset();
  accumulated_.reset();
}

}  // namespace ktgp_orb::sequence
