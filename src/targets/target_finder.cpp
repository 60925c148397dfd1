#include "ktgp_orb/target_finder.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "homography/transform.h"
#include "targets/conflicts.h"
#include "targets/frame_search.h"
#include "targets/searched_frame.h"
#include "targets/target_store.h"
#include "targets/tracks.h"
#include "util/format.h"
#include "util/milliseconds.h"
#include "util/options_check.h"
#include "util/printable.h"

namespace ktgp_orb {
namespace {

using targets::Candidate;
using targets::FoundTarget;
using targets::SearchedFrame;
using targets::StoredTarget;
using targets::TargetPicture;
using targets::Track;
using util::millisecondsSince;
using Clock = std::chrono::steady_clock;

constexpr double kUnlimited = std::numeric_limits<double>::infinity();
/// A target that was seen in the last frame is searched for up to this distance from its predicted
/// position, px of the frame.
constexpr double kSearchRadius = 48.0;

bool havePassed(double milliseconds, Clock::time_point since) {
  return std::isfinite(milliseconds) && millisecondsSince(since) >= milliseconds;
}

bool isSmall(const TargetPicture& picture) {
  return std::min(picture.image.cols, picture.image.rows) < 2.0 * SearchedFrame::kSmallSide;
}

void requireUsable(const TargetFinderOptions& options) {
  util::requireInRange("features of a target", options.features, 50, 5000);
  util::requireInRange("largest_side", options.largest_side, 64, 4000);
  if (options.views != 1 && options.views != 5) {
    throw std::invalid_argument("views is " + std::to_string(options.views) + "; expected 1 or 5");
  }
  // Must be 0, because the enlargement of frames depends on smallest_side, not on first_level.
  util::requireInRange("orb.first_level", options.orb.first_level, 0, 0);
  util::requireInRange("smallest_side", options.smallest_side, 40.0, 1000.0);
  util::requireInRange("search_ms", options.search_ms, 0.0, kUnlimited);
  util::requireInRange("max_instances", options.max_instances, 1, 1000);
}

void setCorners(DetectedTarget& detection) {
  const Eigen::Matrix3d& h = detection.homography.homography;
  const auto corners = homography::imageCorners(detection.image_size, {});
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const auto jacobian = homography::jacobianByEntries(h, corners[i]);
    detection.corners[i] = homography::project(h, corners[i]);
    detection.corner_covariances[i] =
        jacobian * detection.homography.covariance * jacobian.transpose();
  }
}

DetectedTarget detectionOf(const FoundTarget& found, const Track& track, const SearchedFrame& frame,
                           targets::TargetStore& store) {
  const TargetPicture& picture = store.picture(found.picture);
  const StoredTarget& target = *found.target;
  DetectedTarget detection;
  detection.id = target.id;
  detection.width = target.width;
  detection.frame = target.frame;
  detection.ambiguity = target.ambiguity;
  detection.instance = track.instance;
  detection.age = track.age;
  detection.image = found.picture - target.pictures.front();
  detection.image_size = picture.full_size;
  // Converts the homography to px of the images that the caller gave, before they were resized.
  detection.homography = homography::chained(
      {frame.toFrame()}, homography::chained(found.estimate, {targets::toStored(picture)}));
  detection.homography.plane_deviation = found.estimate.plane_deviation / frame.scale();
  detection.aligned = found.aligned;
  detection.inliers = found.keypoints.size();
  detection.log_false_alarms = found.log_false_alarms;
  detection.predicted = found.predicted;
  detection.pairs = found.pairs;
  const Eigen::Matrix3d to_full = targets::toStored(picture).inverse();
  for (Eigen::Vector2d& p : detection.pairs.reference) p = homography::project(to_full, p);
  for (Eigen::Vector2d& p : detection.pairs.target) p = homography::project(frame.toFrame(), p);
  setCorners(detection);
  return detection;
}

/// Returns true if `name` is the tf frame of an instance of the target whose tf frame is `frame`.
/// For the target `door`, `door_1` is the tf frame of instance 1, but `door_0` and `door_01` belong
/// to no instance.
bool isInstanceFrame(const std::string& name, const std::string& frame) {
  const std::size_t first = frame.size() + 1;  // position of the first digit
  return name.size() > first && name.compare(0, first, frame + "_") == 0 && name[first] != '0' &&
         name.find_first_not_of("0123456789", first) == std::string::npos;
}

/// State that is kept from frame to frame.
struct Sequence {
  std::uint64_t number = 0;  // number of the frame; the first frame has number 1
  // Where the next frame starts in the order of look-ups (see FrameSearch::lookUp).
  std::size_t turn = 0;
  targets::Tracks tracks;
  // For each target: number of the last frame in which tryTarget() has searched for it.
  std::unordered_map<const StoredTarget*, std::uint64_t> last_tried;
};

/// Sorts the candidates for the search. Alternates between the target that has waited longest and
/// the target with the most votes.
std::vector<Candidate> inOrder(std::vector<Candidate> by_votes, const Sequence& sequence) {
  const auto last_tried_of = [&](const Candidate& candidate) {
    const auto found = sequence.last_tried.find(candidate.target);
    return found == sequence.last_tried.end() ? 0 : found->second;
  };
  std::vector<Candidate> by_turn = by_votes;
  std::stable_sort(by_votes.begin(), by_votes.end(),
                   [](const Candidate& a, const Candidate& b) { return a.votes > b.votes; });
  std::stable_sort(by_turn.begin(), by_turn.end(), [&](const Candidate& a, const Candidate& b) {
    return last_tried_of(a) < last_tried_of(b);
  });
  std::vector<Candidate> order;
  std::unordered_set<const StoredTarget*> chosen;
  for (std::size_t i = 0; i < by_votes.size(); ++i) {
    for (const Candidate& candidate : {by_turn[i], by_votes[i]}) {
      if (chosen.insert(candidate.target).second) order.push_back(candidate);
    }
  }
  return order;
}

}  // namespace

// NOLINTNEXTLINE(clang-analyzer-optin.performance.Padding): in the order of use
struct TargetFinder::Impl {
  explicit Impl(const TargetFinderOptions& o)
      : options(o),
        frame(std::make_unique<SearchedFrame>(o)),
        checked(checkOptions(o)),
        store(options),
        search(options, store) {
    requireUsable(o);
  }

  static TargetFinderOptions checkOptions(TargetFinderOptions options);
  Eigen::Matrix3d setChecked(const TargetPicture& picture, bool larger);
  const StoredTarget* shownIn(const TargetPicture& picture, bool larger,
                              const StoredTarget* replaced);
  const StoredTarget* smallTwinOf(const TargetPicture& picture, const StoredTarget* replaced);
  void requireDifferent(const std::string& id, const std::vector<TargetPicture>& pictures,
                        const StoredTarget* replaced);
  void requireOwnFrame(const Target& target, const StoredTarget* replaced) const;
  void add(const Target& target, StoredTarget* replaced);
  void remove(const StoredTarget& target);
  void searchFollowed();
  std::size_t lookUp(std::size_t count, double milliseconds, Clock::time_point start);
  void searchOthers();
  void tryTarget(StoredTarget& target);
  bool wantsSmall() const;
  void searchMissing();
  void refine(FoundTarget& one);
  void settle(std::size_t begin);
  void publish();
  void publishUndetermined();
  const TargetFrame& find(Clock::time_point start);

  TargetFinderOptions options;
  std::unique_ptr<SearchedFrame> frame;
  SearchedFrame checked;  // a new target's picture, which is searched for known targets
  targets::TargetStore store;
  targets::FrameSearch search;
  Sequence sequence;
  targets::PictureAligner aligner;
  std::vector<FoundTarget> found;
  std::vector<Track> track_of;  // track of each entry of `found`
  TargetFrame answer;
};

TargetFinderOptions TargetFinder::Impl::checkOptions(TargetFinderOptions options) {
  options.orb.max_features = options.features;
  return options;
}

/// Prepares `search` to find the known targets in `picture`. A small picture gets a border, because
/// no keypoints are found near the border of an image. `larger`: enlarges the picture like a frame
/// in which small targets are wanted. Returns the map from the searched picture to `picture`, px.
Eigen::Matrix3d TargetFinder::Impl::setChecked(const TargetPicture& picture, bool larger) {
  const int border = isSmall(picture) ? targets::kPictureBorder : 0;
  cv::Mat padded = picture.image;
  if (border > 0) {
    cv::copyMakeBorder(picture.image, padded, border, border, border, border, cv::BORDER_REPLICATE);
  }
  checked.set(padded, larger);
  search.setFrame(checked.features(), checked.scale());
  Eigen::Matrix3d without_border = Eigen::Matrix3d::Identity();
  without_border.topRightCorner<2, 1>().setConstant(-border);
  return without_border * checked.toFrame();
}

/// Returns a known target that looks the same as the picture; null if there is none.
const StoredTarget* TargetFinder::Impl::shownIn(const TargetPicture& picture, bool larger,
                                                const StoredTarget* replaced) {
  // Minimum number of votes of a candidate. A lookalike gets many more, but a small picture has few
  // keypoints.
  const std::int32_t fewest = isSmall(picture) ? 2 : 5;
  const UncertainHomography to_picture{setChecked(picture, larger)};
  search.lookUp(0, checked.features().size());
  std::vector<FoundTarget> same;
  for (const Candidate& candidate : search.candidates()) {
    if (candidate.target == replaced || candidate.votes < fewest) continue;
    same.clear();
    search.search(*candidate.target, same);
    for (FoundTarget& other : same) {
      other.estimate = homography::chained(to_picture, other.estimate);
      if (targets::showsTheSame(other, picture, store)) return candidate.target;
    }
  }
  return nullptr;
}

/// Returns a known target that shows the same as `picture` if both are too small for shownIn(),
/// which needs keypoints; null if there is none.
const StoredTarget* TargetFinder::Impl::smallTwinOf(const TargetPicture& picture,
                                                    const StoredTarget* replaced) {
  const auto is_tiny = [](const cv::Mat& image) {
    return std::min(image.cols, image.rows) < SearchedFrame::kSmallSide;
  };
  if (!is_tiny(picture.image)) return nullptr;
  for (const auto& target : store.targets()) {
    if (target.get() == replaced) continue;
    for (const std::uint32_t number : target->pictures) {
      const TargetPicture& known = store.picture(number);
      if (is_tiny(known.image) && targets::showTheSame(known, picture)) return target.get();
    }
  }
  return nullptr;
}

/// Throws if a known target and a new picture show nearly the same part of the scene. A target that
/// covers only a part of the picture, such as a logo, is allowed. A small picture has few keypoints
/// at its original size, so we also search an enlarged copy of it, and compare the small pictures
/// as a whole.
void TargetFinder::Impl::requireDifferent(const std::string& id,
                                          const std::vector<TargetPicture>& pictures,
                                          const StoredTarget* replaced) {
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    const StoredTarget* same = shownIn(pictures[i], false, replaced);
    if (same == nullptr && isSmall(pictures[i])) same = shownIn(pictures[i], true, replaced);
    if (same == nullptr) same = smallTwinOf(pictures[i], replaced);
    if (same == nullptr) continue;
    throw std::invalid_argument("target " + util::quoted(id) + ": image " + std::to_string(i + 1) +
                                " shows the same as target " + util::quoted(same->id) +
                                "; they could not be told apart");
  }
}

/// Throws if another target uses the same tf frame, because a tf frame can have only one parent.
void TargetFinder::Impl::requireOwnFrame(const Target& target, const StoredTarget* replaced) const {
  const std::string frame = util::withoutSlash(target.frame);
  if (frame.empty()) return;
  for (const auto& other : store.targets()) {
    if (other.get() == replaced || other->frame.empty()) continue;
    if (other->frame != frame && !isInstanceFrame(other->frame, frame) &&
        !isInstanceFrame(frame, other->frame)) {
      continue;
    }
    throw std::invalid_argument(
        "target " + util::quoted(target.id) + ": the frame " + util::quoted(frame) +
        " meets the frame " + util::quoted(other->frame) + " of target " + util::quoted(other->id) +
        "; expected one that no instance of another has");
  }
}

void TargetFinder::Impl::add(const Target& target, StoredTarget* replaced) {
  requireOwnFrame(target, replaced);
  // Creating the tilted views takes most of the time, so they are created only for targets that are
  // not refused.
  std::vector<TargetPicture> pictures = store.prepare(target, 1);
  requireDifferent(target.id, pictures, replaced);
  if (options.views > 1) pictures = store.prepare(target, options.views);
  if (replaced != nullptr) remove(*replaced);
  store.add(target, std::move(pictures));
}

void TargetFinder::Impl::remove(const StoredTarget& target) {
  sequence.tracks.forget(target);
  sequence.last_tried.erase(&target);
  store.remove(target);
}

void TargetFinder::Impl::tryTarget(StoredTarget& target) {
  sequence.last_tried[&target] = sequence.number;
  ++answer.tried;
  if (search.search(target, found) == options.max_instances) answer.at_limit = target.id;
}

void TargetFinder::Impl::searchFollowed() {
  for (const auto& target : store.targets()) {
    if (sequence.tracks.wasSeen(*target)) tryTarget(*target);
  }
}

/// Looks up the keypoints in parts, at least one part, until `milliseconds` have passed since
/// `start`. The next frame continues after the last part. Returns the number of frames that are
/// needed at this pace to look up all keypoints.
std::size_t TargetFinder::Impl::lookUp(std::size_t count, double milliseconds,
                                       Clock::time_point start) {
  constexpr std::size_t kPart = 128;
  std::size_t done = 0;
  std::size_t& turn = sequence.turn;
  while (done < count && (done == 0 || !havePassed(milliseconds, start))) {
    search.lookUp(turn + done, kPart);
    done += kPart;
  }
  turn = done < count ? (turn + done) % count : 0;
  return done < count ? (count + done - 1) / done : 1;
}

/// Tries the candidates that have not been tried in this frame yet, until the time is used up. The
/// first two are always tried: the target that has waited longest, and the target with the most
/// votes.
void TargetFinder::Impl::searchOthers() {
  constexpr std::size_t kAlways = 2;
  const Clock::time_point start = Clock::now();
  // Use less time while a target is followed, so that the robot has time for other work.
  const double milliseconds = (found.empty() ? 1.0 : 0.1) * options.search_ms;
  // Look up keypoints for half of the time; the other half is left for trying the candidates.
  const std::size_t frames = lookUp(answer.features, 0.5 * milliseconds, start);
  std::vector<Candidate> others;
  for (const Candidate& candidate : search.candidates()) {
    const auto tried = sequence.last_tried.find(candidate.target);
    const bool is_tried = tried != sequence.last_tried.end() && tried->second == sequence.number;
    if (!is_tried) others.push_back(candidate);
  }
  answer.candidates = answer.tried + others.size();
  std::size_t tried = 0;
  for (const Candidate& candidate : inOrder(std::move(others), sequence)) {
    if (tried++ >= kAlways && havePassed(milliseconds, start)) break;
    tryTarget(*candidate.target);
  }
  answer.frames_for_all = frames + answer.candidates - answer.tried;
}

void TargetFinder::Impl::searchMissing() {
  for (const Track& track : sequence.tracks.missing()) {
    StoredTarget* target = store.find(track.target->id);
    search.searchNear(*target, track.picture, targets::predicted(track),
                      frame->scale() * kSearchRadius, found);
  }
}

void TargetFinder::Impl::publish() {
  answer.detections.clear();
  const std::vector<std::uint8_t> is_doubtful = targets::conflicts(found, store);
  for (std::size_t i = 0; i < found.size(); ++i) {
    DetectedTarget detection = detectionOf(found[i], track_of[i], *frame, store);
    if (is_doubtful[i] != 0) detection.status = Status::model_rejected;
    answer.detections.push_back(std::move(detection));
  }
  publishUndetermined();
  std::sort(answer.detections.begin(), answer.detections.end(),
            [](const DetectedTarget& a, const DetectedTarget& b) {
              return a.id != b.id ? a.id < b.id : a.instance < b.instance;
            });
}

/// Returns true if the frame should be enlarged so that small targets can be found: if no target is
/// followed, a small target is followed or a target was lost, and in every eighth frame, to find
/// new targets. Other frames are not enlarged, so a robot that tracks large targets has time for
/// other work. Always returns false if options.smallest_side excludes small targets.
bool TargetFinder::Impl::wantsSmall() const {
  constexpr std::uint64_t kEach = 8;
  if (options.smallest_side >= SearchedFrame::kSmallSide) return false;
  return sequence.number % kEach == 0 ||
         sequence.tracks.needsLargerFrame(SearchedFrame::kSmallSide);
}

/// Refines the homography by aligning patches of the picture with the original frame instead of the
/// searched frame, in two cases. First, if the searched frame was shrunk: the original frame shows
/// more details. This helps only if the picture shows them, too, so it must not be stretched by
/// more than kMostStretch in the original frame. Second, if the searched frame was enlarged: a
/// patch of it has a wider blur and so shows fewer details. In the second case, small targets are
/// not refined, because they have too few patches in the original frame.
void TargetFinder::Impl::refine(FoundTarget& one) {
  constexpr double kMostStretch = 1.2;  // largest scale from the picture to the original frame
  if (frame->own().empty()) return;
  const TargetPicture& picture = store.picture(one.picture);
  UncertainHomography estimate = homography::chained({frame->toFrame()}, one.estimate);
  const cv::Size size = picture.image.size();
  const Eigen::Vector2d middle(0.5 * size.width, 0.5 * size.height);
  const double stretch =
      std::sqrt(homography::jacobianByPoint(estimate.homography, middle).determinant());
  const double side = stretch * std::min(size.width, size.height);
  const bool is_finer = frame->scale() < 1.0 && stretch <= kMostStretch;
  const bool is_sharper = frame->scale() > 1.0 && side >= SearchedFrame::kSmallSide;
  if (!is_finer && !is_sharper) return;
  PointPairs pairs;
  if (!aligner.align(picture, frame->own(), estimate, pairs)) return;
  one.aligned = true;
  const Eigen::Matrix3d to_searched = frame->toFrame().inverse();
  one.estimate = homography::chained({to_searched}, estimate);
  for (Eigen::Vector2d& p : pairs.target) p = homography::project(to_searched, p);
  one.pairs = std::move(pairs);
}

/// Refines the instances in `found` from index `begin` on, and moves instances with undetermined
/// corners to search.undetermined(). Multiplies the covariance by kSharedDisplacement if the images
/// could not be aligned, which happens if the frame is blurred or dark, or the view is steep. Blur
/// displaces neighbouring keypoints together, so many keypoints give hardly more information than a
/// few, and the covariance of the fit is too small. In synthetic frames with 4 to 20 px of blur,
/// the squared errors of the corners were 10 to 140 times as large as this covariance predicts, and
/// some corners were 20 px off.
void TargetFinder::Impl::settle(std::size_t begin) {
  constexpr double kSharedDisplacement = 36.0;
  const bool has_images = !frame->features().images.empty();
  std::size_t kept = begin;
  for (std::size_t i = begin; i < found.size(); ++i) {
    FoundTarget& one = found[i];
    refine(one);
    if (has_images && !one.aligned) one.estimate.covariance *= kSharedDisplacement;
    if (!targets::PictureSearch::isDetermined(store.picture(one.picture), one)) {
      search.undetermined().push_back(std::move(one));
      continue;
    }
    if (kept != i) found[kept] = std::move(one);
    ++kept;
  }
  found.resize(kept);
}

/// Reports each target for which only instances with undetermined corners were found.
void TargetFinder::Impl::publishUndetermined() {
  if (search.undetermined().empty()) return;
  std::unordered_set<const StoredTarget*> named;
  for (const FoundTarget& one : found) named.insert(one.target);
  for (const FoundTarget& one : search.undetermined()) {
    if (!named.insert(one.target).second) continue;
    DetectedTarget detection = detectionOf(one, {}, *frame, store);
    detection.status = Status::model_rejected;
    detection.uncertain = true;
    answer.detections.push_back(std::move(detection));
  }
}

const TargetFrame& TargetFinder::Impl::find(Clock::time_point start) {
  const Features& given = frame->features();
  targets::Tracks& tracks = sequence.tracks;
  tracks.setScale(frame->scale());
  answer.tried = 0;
  answer.at_limit.clear();
  answer.known = store.targets().size();
  answer.features = given.size();
  answer.extraction_milliseconds = millisecondsSince(start);
  found.clear();
  store.index().optimise();
  search.setFrame(given, frame->scale());
  tracks.beginFrame();
  searchFollowed();
  searchOthers();
  settle(0);
  track_of.clear();
  tracks.assign(found, store, track_of);
  const std::size_t count = found.size();
  searchMissing();
  settle(count);
  tracks.assign({found.begin() + static_cast<std::ptrdiff_t>(count), found.end()}, store, track_of);
  publish();
  tracks.endFrame();
  answer.milliseconds = millisecondsSince(start);
  return answer;
}

TargetFinder::TargetFinder(const TargetFinderOptions& options)
    : impl_(std::make_unique<Impl>(options)) {}
TargetFinder::~TargetFinder() = default;
TargetFinder::TargetFinder(TargetFinder&&) noexcept = default;
TargetFinder& TargetFinder::operator=(TargetFinder&&) noexcept = default;

const TargetFinderOptions& TargetFinder::options() const {
  return impl_->options;
}

void TargetFinder::setSearch(double search_ms, double smallest_side, int max_instances) {
  TargetFinderOptions changed = impl_->options;
  changed.search_ms = search_ms;
  changed.smallest_side = smallest_side;
  changed.max_instances = max_instances;
  requireUsable(changed);
  impl_->options = changed;
}

void TargetFinder::add(const Target& target) {
  if (knows(target.id)) {
    throw std::invalid_argument("target " + util::quoted(target.id) +
                                " exists already; expected a new id");
  }
  impl_->add(target, nullptr);
}

void TargetFinder::replace(const Target& target) {
  StoredTarget* replaced = impl_->store.find(target.id);
  if (replaced == nullptr) {
    throw std::invalid_argument("target " + util::quoted(target.id) + " does not exist");
  }
  impl_->add(target, replaced);
}

bool TargetFinder::remove(const std::string& id) {
  const StoredTarget* target = impl_->store.find(id);
  if (target == nullptr) return false;
  impl_->remove(*target);
  return true;
}

std::vector<std::string> TargetFinder::ids() const {
  std::vector<std::string> ids;
  for (const auto& target : impl_->store.targets()) ids.push_back(target->id);
  return ids;
}

bool TargetFinder::knows(const std::string& id) const {
  return impl_->store.find(id) != nullptr;
}

std::string TargetFinder::ambiguity(const std::string& id) const {
  const StoredTarget* target = impl_->store.find(id);
  return target == nullptr ? "" : target->ambiguity;
}

const TargetFrame& TargetFinder::find(const cv::Mat& image) {
  const Clock::time_point start = Clock::now();
  ++impl_->sequence.number;
  impl_->frame->set(image, impl_->wantsSmall());
  return impl_->find(start);
}

const TargetFrame& TargetFinder::find(const Features& features) {
  requireValid(features, "frame");
  if (features.descriptor != impl_->options.orb.descriptor) {
    throw std::invalid_argument(std::string("the frame has ") + toString(features.descriptor) +
                                " descriptors; expected " +
                                toString(impl_->options.orb.descriptor));
  }
  ++impl_->sequence.number;
  impl_->frame->set(features);
  return impl_->find(Clock::now());
}

const TargetFrame& TargetFinder::findAlone(const cv::Mat& image) {
  const Sequence followed = std::exchange(impl_->sequence, {});
  // Search with separate buffers. The image may need large buffers, which are freed afterwards; the
  // sequence keeps its own buffers.
  std::unique_ptr<SearchedFrame> of_sequence =
      std::exchange(impl_->frame, std::make_unique<SearchedFrame>(impl_->options));
  const double search_ms = std::exchange(impl_->options.search_ms, kUnlimited);
  const auto restore = [&] {
    impl_->sequence = followed;
    impl_->frame = std::move(of_sequence);
    impl_->options.search_ms = search_ms;
  };
  try {
    find(image);
  } catch (...) {
    restore();
    throw;
  }
  restore();
  return impl_->answer;
}

void TargetFinder::restart() {
  impl_->sequence.tracks.clear();
}

}  // namespace ktgp_orb
