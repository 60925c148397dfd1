#include "ktgp_orb/sequence_matcher.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "features/orb/image_check.h"
#include "sequence/frames.h"
#include "sequence/motion_predictor.h"
#include "sequence/reference_keeper.h"
#include "sequence/reference_views.h"
#include "sequence/repeats.h"
#include "util/milliseconds.h"
#include "util/names.h"

namespace ktgp_orb {
namespace {

void requireValid(const ReferenceOptions& options) {
  const auto refuse = [](const std::string& name, double value, const std::string& expected) {
    throw std::invalid_argument(name + " is " + std::to_string(value) + "; expected " + expected);
  };
  // Written like this, the comparison also refuses NaN.
  if (!(options.max_age > 0.0)) refuse("max_age", options.max_age, "a time above 0 s");
  if (!(options.min_overlap >= 0.0 && options.min_overlap <= 1.0)) {
    refuse("min_overlap", options.min_overlap, "a share in [0, 1]");
  }
  if (options.min_inliers < 4) refuse("min_inliers", options.min_inliers, "at least 4");
  if (options.enlarge_below < 0) refuse("enlarge_below", options.enlarge_below, "at least 0 px");
}

std::int64_t stampOf(double seconds) {
  constexpr double kMaxSeconds = 9.2e9;  // s; in nanoseconds, longer times do not fit in 64 bits
  if (!(std::abs(seconds) < kMaxSeconds)) {
    throw std::invalid_argument("the frame's time is " + std::to_string(seconds) +
                                " s; expected a finite one within 9.2e9 s of zero");
  }
  return std::llround(1e9 * seconds);
}

/// Factor by which images must be enlarged because the reference of the fixed mode is too small. 1
/// if it is large enough, and in other modes.
double enlargementOf(const Frame* fixed, const ReferenceOptions& options) {
  // Enlarge the shorter side to this length, px. It is about the width of ten descriptor patches.
  constexpr double kWanted = 300.0;
  constexpr double kMost = 4.0;
  if (options.mode != ReferenceMode::fixed || fixed == nullptr) return 1.0;
  const int shorter = std::min(fixed->image.cols, fixed->image.rows);
  const bool is_small = shorter > 0 && shorter < options.enlarge_below;
  return is_small ? std::clamp(kWanted / shorter, 1.0, kMost) : 1.0;
}

/// Adds pyramid levels for enlarged copies of the image to the options. The largest copy is at most
/// `scale` times as large as the image, and its longer side is at most 2500 px.
OrbOptions enlarged(OrbOptions options, const cv::Size& size, double scale) {
  constexpr double kLargest = 2500.0;  // px
  constexpr int kMostLevels = 16;
  if (scale <= 1.0 || options.descriptor == DescriptorKind::teblid) return options;
  const double most = std::min(scale, kLargest / std::max(size.width, size.height));
  const int more = static_cast<int>(std::log(std::max(most, 1.0)) / std::log(options.scale_factor));
  options.first_level += std::min(more, kMostLevels - 1 - options.first_level);
  options.levels = std::max(std::min(options.levels + more, kMostLevels), options.first_level + 1);
  return options;
}

/// Returns true if the features of the frame were extracted with options other than `wanted`. Such
/// features cannot be matched to features with the options `wanted`, so they must be extracted
/// again.
bool isOutdated(const Frame& frame, const OrbOptions& wanted) {
  return !frame.image.empty() && frame.orb != wanted;
}

void setCameras(const Frame& reference, const Frame& target, MatchHints& hints) {
  if (!reference.camera || !target.camera) return;
  hints.reference_camera = reference.camera;
  hints.target_camera = target.camera;
  hints.reference_lens = reference.camera_lens.get();
  hints.target_lens = target.camera_lens.get();
}

}  // namespace

// Adapts the options to a sequence. The features need no copies of the pyramid images, because the
// sequence keeps the frames. Switches growth off in previous mode.
SequenceOptions withImages(SequenceOptions options) {
  options.orb.images = options.matcher.alignment.enabled ? ImageKeeping::share : ImageKeeping::none;
  if (options.reference.mode == ReferenceMode::previous) options.matcher.growth.enabled = false;
  return options;
}

bool canMatchAhead(const MatcherOptions& options) {
  return options.knn.search_radius == 0.0 && options.growth.views == 0 &&
         options.geometry == GeometryModel::homography;
}

namespace {

/// Removes the keypoints that the lens could not rectify. Lens::rectify() has set their positions
/// to NaN.
void dropUnplaced(Features& features) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < features.size(); ++i) {
    if (std::isnan(features.keypoints[i].pt.x)) continue;
    if (kept != i) {
      features.keypoints[kept] = features.keypoints[i];
      features.descriptors.row(static_cast<int>(i))
          .copyTo(features.descriptors.row(static_cast<int>(kept)));
    }
    ++kept;
  }
  features.keypoints.resize(kept);
  features.descriptors = features.descriptors.rowRange(0, static_cast<int>(kept));
}

}  // namespace

void extractFeatures(OrbExtractor& extractor, Frame& frame) {
  const auto start = std::chrono::steady_clock::now();
  extractor.extract(frame.image, frame.mask, frame.features);
  if (frame.lens) {
    frame.lens->rectify(frame.features.keypoints);
    dropUnplaced(frame.features);
    frame.features.images
        .clear();  // the pyramid images are not rectified, so they do not fit the keypoints
  }
  frame.extraction_milliseconds = util::millisecondsSince(start);
  frame.orb = extractor.options();
}

struct SequenceMatcher::Impl {
  explicit Impl(const SequenceOptions& wanted)
      : options(withImages(wanted)), extractor(options.orb), matcher(options.matcher) {
    requireValid(wanted.reference);
    keeper.setOptions(wanted.reference);
    answer.match.clear(options.matcher);
  }

  void setOptions(const SequenceOptions& as_given);
  OrbOptions orbFor(const Frame& frame, const Frame* fixed) const;
  /// The frame that will be the reference of the fixed mode when `frame` is matched; null if there
  /// is none.
  const Frame* fixedFor(const Frame& frame) const {
    return fix_next_frame ? &frame : keeper.fixed().get();
  }
  void extract(Frame& frame, const OrbOptions& orb);
  FramePtr withFeatures(const FramePtr& frame, const OrbOptions& orb);
  FramePtr foundAnew(const FramePtr& frame, const OrbOptions& orb);
  const ReferenceViews* viewsOf(const FramePtr& reference);
  void matchTo(FramePtr& reference, const Frame& target, MatchResult& result);
  void matchToBest(const Frame& frame, FramePtr& reference, MatchAhead* ahead);
  const SequenceMatch& match(const FramePtr& given, MatchAhead* ahead);
  bool repeatsAnswer(const Frame& frame);
  void forgetAnswer();

  SequenceOptions options;
  OrbExtractor extractor;
  KtgpMatcher matcher;
  sequence::ReferenceKeeper keeper;
  sequence::MotionPredictor predictor;
  sequence::TrackNumbers tracks;
  sequence::Repeats repeats;
  sequence::FramePool pool;
  sequence::ReferenceViewsMaker views;
  SequenceMatch answer;
  MatchResult other_result;
  MatchResult whole_result;
  std::optional<RelativePose> last_motion;  // motion between the previous frame and its reference
  double lost_milliseconds = 0.0;           // duration of matches that were discarded
  bool fix_next_frame = false;
  bool has_other_input = false;  // options or fixed reference have changed since `answer`
  bool had_reference = false;    // `answer` had a reference before forgetAnswer()
};

void SequenceMatcher::Impl::setOptions(const SequenceOptions& as_given) {
  const SequenceOptions wanted = withImages(as_given);
  // First make all calls that may throw: if one of them throws, the matcher is unchanged.
  requireValid(wanted.reference);
  OrbExtractor new_extractor(wanted.orb);
  KtgpMatcher new_matcher(wanted.matcher);
  const bool same_features = wanted.orb == options.orb;
  if (!same_features) extractor = std::move(new_extractor);
  matcher = std::move(new_matcher);
  // Other options, such as those of a mask that moves, keep the views: making them takes a while.
  if (!same_features || wanted.matcher.growth.views != options.matcher.growth.views) views.forget();
  keeper.setOptions(wanted.reference);
  options = wanted;
  has_other_input = true;
}

/// Options for extracting the features of `frame`. `fixed`: the fixed reference; null if there is
/// none. If it is small, the options also enlarge the frame.
OrbOptions SequenceMatcher::Impl::orbFor(const Frame& frame, const Frame* fixed) const {
  return enlarged(options.orb, frame.image.size(), enlargementOf(fixed, options.reference));
}

void SequenceMatcher::Impl::extract(Frame& frame, const OrbOptions& orb) {
  if (orb != extractor.options()) extractor = OrbExtractor(orb);
  extractFeatures(extractor, frame);
}

/// Returns the simulated views of the reference, or null. Making views takes long, so only a fixed
/// reference has them. A reference with a lens has none, because keypoints of a simulated view
/// cannot be rectified.
const ReferenceViews* SequenceMatcher::Impl::viewsOf(const FramePtr& reference) {
  const GrowthOptions& growth = options.matcher.growth;
  const bool wanted = growth.enabled && growth.views > 0 &&
                      options.reference.mode == ReferenceMode::fixed && !reference->lens &&
                      !reference->image.empty();
  if (!wanted) {
    views.forget();
    return nullptr;
  }
  return views.of(reference, orbFor(*reference, reference.get()), growth.views,
                  options.views_in_background);
}

/// Returns `frame` with features that were extracted with the options `orb`. If the frame has no
/// features yet, adds them to it; if it has other features, returns a new frame.
FramePtr SequenceMatcher::Impl::withFeatures(const FramePtr& frame, const OrbOptions& orb) {
  if (!isOutdated(*frame, orb)) return frame;
  if (frame->orb) return foundAnew(frame, orb);
  extract(*frame, orb);
  return frame;
}

/// Extracts the features of the image again, for a new frame that replaces `frame` as a reference.
/// `frame` itself is not changed, because others may be using it.
FramePtr SequenceMatcher::Impl::foundAnew(const FramePtr& frame, const OrbOptions& orb) {
  FramePtr fresh = pool.take();
  static_cast<FrameInput&>(*fresh) = *frame;
  fresh->source = frame;  // keeps the pixels valid
  extract(*fresh, orb);
  keeper.replace(frame, fresh);
  predictor.replace(*frame, *fresh);
  if (answer.reference == frame) answer.reference = fresh;
  return fresh;
}

void SequenceMatcher::Impl::matchTo(FramePtr& reference, const Frame& target, MatchResult& result) {
  MatchHints hints;
  const OrbOptions orb = orbFor(*reference, keeper.fixed().get());
  if (isOutdated(*reference, orb)) reference = foundAnew(reference, orb);
  hints.views = viewsOf(reference);
  setCameras(*reference, target, hints);
  if (options.reference.mode == ReferenceMode::previous) hints.motion = last_motion;
  const bool near = options.matcher.knn.search_radius > 0.0;
  if (near) hints.prediction = predictor.predict(*reference, target);
  matcher.match(reference->features, target.features, hints, result);
  if (result.search != Search::near || !predictor.isPoor(result)) return;
  // Few inliers were found near the prediction, so match again without a search radius. `result`
  // becomes the better of the two matches.
  hints.prediction.reset();
  hints.whole_image = true;
  matcher.match(reference->features, target.features, hints, whole_result);
  ++answer.fall_backs;
  const bool keep = result.status == Status::ok &&
                    (whole_result.status != Status::ok || whole_result.inliers < result.inliers);
  if (!keep) {
    std::swap(result, whole_result);
    result.search = Search::fell_back;
  }
  lost_milliseconds += whole_result.milliseconds();
}

/// Matches the frame to `reference`. If this is a keyframe and the match is weak, also matches the
/// frame to the previous frame; if that succeeds, the previous frame becomes `reference`.
void SequenceMatcher::Impl::matchToBest(const Frame& frame, FramePtr& reference,
                                        MatchAhead* ahead) {
  if (canMatchAhead(options.matcher) && ahead != nullptr && ahead->reference == reference) {
    std::swap(answer.match, ahead->result);
  } else {
    matchTo(reference, frame, answer.match);
  }
  FramePtr before = keeper.secondChoice(frame, answer.match);
  if (!before) return;
  matchTo(before, frame, other_result);
  if (other_result.homographyStatus() == Status::ok) {
    std::swap(answer.match, other_result);
    reference = before;
  }
  lost_milliseconds += other_result.milliseconds();
}

/// Returns true if `frame` repeats the image of the last answer. Call this before extracting
/// features, because a repeated image does not need them.
bool SequenceMatcher::Impl::repeatsAnswer(const Frame& frame) {
  if (!answer.frame || has_other_input || fix_next_frame) return false;
  const Frame& last = *answer.frame;
  // If the mask has changed, the result may be different, so the image is not a repetition.
  if (frame.mask.data != last.mask.data) return false;
  if (sequence::anotherCamera(frame, last) != NoReference::none) return false;
  return repeats.repeats(frame.image, frame.stamp, last.image, last.stamp);
}

const SequenceMatch& SequenceMatcher::Impl::match(const FramePtr& given, MatchAhead* ahead) {
  // First make all calls that may throw.
  if (!given->image.empty()) orb::requireValid(given->image, given->mask);
  answer.repeated = repeatsAnswer(*given);
  if (answer.repeated) return answer;
  const FramePtr frame = withFeatures(given, orbFor(*given, fixedFor(*given)));
  if (frame != given) ahead = nullptr;  // `ahead` was made with the old features
  ktgp_orb::requireValid(frame->features, "target");
  if (std::exchange(fix_next_frame, false)) keeper.setFixed(frame);
  FramePtr reference = keeper.referenceFor(*frame);
  lost_milliseconds = 0.0;
  if (reference) {
    matchToBest(*frame, reference, ahead);
    predictor.advance(*frame, *reference, answer.match);
    // A reference has no track numbers yet if it is fixed or if its features were extracted again.
    if (reference->tracks.empty()) tracks.begin(*reference);
    tracks.continueTracks(*reference, answer.match, *frame);
  } else {
    predictor.restartAt(*frame);
    tracks.begin(*frame);
    answer.match.clear(options.matcher);
    answer.match.descriptor = frame->features.descriptor;
  }
  last_motion.reset();
  if (answer.match.geometry == Geometry::epipolar) last_motion = answer.match.two_view.view.pose;
  keeper.advance(frame, reference, reference ? &answer.match : nullptr);

  has_other_input = false;
  const bool was_forgotten = std::exchange(had_reference, false);
  answer.reference_changed = was_forgotten || reference != answer.reference;
  answer.frame = frame;
  answer.reference = reference;
  answer.no_reference = keeper.reason();
  answer.accumulated = keeper.accumulated();
  answer.first_stamp = keeper.firstStamp();
  answer.total_milliseconds =
      frame->extraction_milliseconds + answer.match.milliseconds() + lost_milliseconds;
  reference.reset();
  return answer;
}

void SequenceMatcher::Impl::forgetAnswer() {
  had_reference = had_reference || answer.reference;
  answer.frame.reset();
  answer.reference.reset();
  answer.accumulated.reset();
  predictor.forget();
  repeats.forget();
  views.forget();
  last_motion.reset();
}

SequenceMatcher::SequenceMatcher(const SequenceOptions& options)
    : impl_(std::make_unique<Impl>(options)) {}
SequenceMatcher::~SequenceMatcher() = default;
SequenceMatcher::SequenceMatcher(SequenceMatcher&&) noexcept = default;
SequenceMatcher& SequenceMatcher::operator=(SequenceMatcher&&) noexcept = default;

const SequenceOptions& SequenceMatcher::options() const {
  return impl_->options;
}

void SequenceMatcher::setOptions(const SequenceOptions& options) {
  impl_->setOptions(options);
}

const SequenceMatch& SequenceMatcher::match(const cv::Mat& image, double seconds,
                                            const std::string& encoding) {
  const std::int64_t stamp = stampOf(seconds);
  const FramePtr frame = impl_->pool.takeCopy(image);
  frame->stamp = stamp;
  frame->encoding = encoding;
  // match() does not extract features from an empty image, so call extract() here: it removes the
  // features that the frame still has from earlier.
  if (image.empty()) impl_->extract(*frame, impl_->options.orb);
  return impl_->match(frame, nullptr);
}

const SequenceMatch& SequenceMatcher::match(const Features& features, double seconds) {
  const std::int64_t stamp = stampOf(seconds);
  const FramePtr frame = impl_->pool.take();
  frame->stamp = stamp;
  frame->features.keypoints = features.keypoints;
  features.descriptors.copyTo(frame->features.descriptors);
  frame->features.descriptor = features.descriptor;
  frame->features.image_size = features.image_size;
  frame->features.images = features.images;  // shared with the caller
  return impl_->match(frame, nullptr);
}

const SequenceMatch& SequenceMatcher::match(const FramePtr& frame, MatchAhead* ahead) {
  return impl_->match(frame, ahead);
}

FramePtr SequenceMatcher::newFrame() {
  return impl_->pool.take();
}

void SequenceMatcher::setFixedReference(const FramePtr& frame) {
  // In other modes, the fixed reference is not used yet; its features are extracted when it is
  // first needed.
  const bool now = impl_->options.reference.mode == ReferenceMode::fixed;
  const FramePtr fixed =
      frame && now ? impl_->withFeatures(frame, impl_->orbFor(*frame, frame.get())) : frame;
  if (fixed) ktgp_orb::requireValid(fixed->features, "reference");
  impl_->keeper.setFixed(fixed);
  impl_->has_other_input = true;  // match the image again, even if it is a repetition
}

FrameConstPtr SequenceMatcher::fixedReference() const {
  return impl_->keeper.fixed();
}

ViewsState SequenceMatcher::viewsState() const {
  return impl_->views.state();
}

void SequenceMatcher::fixNextFrame() {
  impl_->fix_next_frame = true;
}

void SequenceMatcher::restart() {
  impl_->keeper.forget(NoReference::first_frame);
  impl_->forgetAnswer();
}

void SequenceMatcher::reset() {
  impl_->keeper.forget(NoReference::reset);
  impl_->keeper.setFixed(nullptr);
  impl_->fix_next_frame = false;
  impl_->forgetAnswer();
}

const char* toString(ViewsState state) {
  return util::nameOf<ViewsState::ready>(state, {"none", "being_made", "ready"});
}

const char* toString(NoReference reason) {
  return util::nameOf<NoReference::lens_changed>(
      reason, {"none", "first_frame", "gap", "stamp_went_back", "size_changed", "encoding_changed",
               "not_set", "reset", "mode_changed", "lens_changed"});
}

}  // namespace ktgp_orb
