#include "ktgp_orb/target_finder.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <utility>

#include "core/homography/covariance.h"
#include "core/homography/transform.h"
#include "core/util/options_check.h"
#include "core/util/printable.h"
#include "targets/conflicts.h"
#include "targets/frame_search.h"
#include "targets/target_store.h"
#include "targets/tracks.h"

namespace ktgp_orb {
namespace {

using targets::Candidate;
using targets::FoundTarget;
using targets::StoredTarget;
using targets::TargetPicture;
using targets::Track;
using Clock = std::chrono::steady_clock;

double millisecondsSince(Clock::time_point start) {
  return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
}

/// A span of time that begins now.
class Budget {
 public:
  explicit Budget(double milliseconds) : milliseconds_(milliseconds) {}
  /// Whether this share of it has passed.
  bool isOver(double share = 1.0) const {
    return std::isfinite(milliseconds_) && millisecondsSince(start_) >= share * milliseconds_;
  }

 private:
  double milliseconds_;
  Clock::time_point start_ = Clock::now();
};

void requireUsable(const TargetFinderOptions& options) {
  util::requireInRange("features of a target", options.features, 50, 5000);
  util::requireInRange("largest_side", options.largest_side, 64, 4000);
  if (options.views != 1 && options.views != 5) {
    throw std::invalid_argument("views is " + std::to_string(options.views) + "; expected 1 or 5");
  }
  util::requireInRange("search_radius", options.search_radius, 0.0, 1000.0);
  util::requireInRange("search_ms", options.search_ms, 0.0,
                       std::numeric_limits<double>::infinity());
  util::requireInRange("max_instances", options.max_instances, 1, 1000);
}

/// The same homography for the image as it was given, before it was made smaller.
UncertainHomography ofFullImage(const TargetPicture& picture, const UncertainHomography& found) {
  UncertainHomography full = homography::chained(found, {targets::toStored(picture)});
  full.plane_deviation = found.plane_deviation;
  return full;
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

DetectedTarget detectionOf(const FoundTarget& found, const Track& track,
                           targets::TargetStore& store) {
  const TargetPicture& picture = store.picture(found.picture);
  const StoredTarget& target = *found.target;
  DetectedTarget detection;
  detection.id = target.id;
  detection.width = target.width;
  detection.frame = target.frame;
  detection.instance = track.instance;
  detection.age = track.age;
  detection.image = found.picture - target.pictures.front();
  detection.image_size = picture.full_size;
  detection.homography = ofFullImage(picture, found.found.estimate);
  detection.aligned = found.found.aligned;
  detection.inliers = found.found.keypoints.size();
  detection.log_false_alarms = found.found.log_false_alarms;
  detection.predicted = found.predicted;
  detection.pairs = found.found.pairs;
  const Eigen::Matrix3d to_full = targets::toStored(picture).inverse();
  for (Eigen::Vector2d& p : detection.pairs.reference) p = homography::project(to_full, p);
  setCorners(detection);
  return detection;
}

}  // namespace

struct TargetFinder::Impl {
  explicit Impl(const TargetFinderOptions& o)
      : options(o),
        extractor(o.orb),
        check_extractor(checkOptions(o)),
        store(options),
        search(options, store) {
    requireUsable(o);
  }

  static OrbOptions checkOptions(const TargetFinderOptions& options);
  void requireDifferent(const std::string& id, const std::vector<TargetPicture>& pictures,
                        const StoredTarget* replaced);
  void add(const Target& target, StoredTarget* replaced);
  void searchFollowed();
  std::size_t lookUp(std::size_t count, const Budget& budget);
  double timeForOthers() const;
  void searchOthers();
  void tryTarget(StoredTarget& target);
  void searchMissing();
  void publish();
  const TargetFrame& find(const Features& given, Clock::time_point start);

  TargetFinderOptions options;
  OrbExtractor extractor;
  OrbExtractor check_extractor;
  targets::TargetStore store;
  targets::FrameSearch search;
  targets::Tracks tracks;
  std::uint64_t frame_number = 0;
  Features features;
  std::vector<FoundTarget> found;
  std::size_t turn = 0;            // where the next frame begins to look keypoints up
  std::vector<Candidate> others;   // not seen in the last frame; those with most votes first
  std::vector<Candidate> in_turn;  // the same; those that have waited longest first
  std::vector<Track> track_of;     // for each one in `found`
  TargetFrame answer;
};

OrbOptions TargetFinder::Impl::checkOptions(const TargetFinderOptions& options) {
  OrbOptions orb = options.orb;
  orb.max_features = options.features;
  return orb;
}

/// Searches the known targets in the new pictures, and throws if one shows the same. One that
/// covers only a part of the new picture, such as a logo, does not.
void TargetFinder::Impl::requireDifferent(const std::string& id,
                                          const std::vector<TargetPicture>& pictures,
                                          const StoredTarget* replaced) {
  constexpr std::int32_t kFewestVotes = 5;  // one that shows the same has many more
  Features own;
  std::vector<FoundTarget> same;
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    check_extractor.extract(pictures[i].image, own);
    search.setFrame(own);
    search.lookUp(0, own.size());
    for (const Candidate& candidate : search.candidates()) {
      if (candidate.target == replaced || candidate.votes < kFewestVotes) continue;
      same.clear();
      search.search(*candidate.target, same);
      for (const FoundTarget& other : same) {
        if (!targets::showsTheSame(other, pictures[i].image.size(), store)) continue;
        throw std::invalid_argument("target " + util::quoted(id) + ": image " +
                                    std::to_string(i + 1) + " shows the same as target " +
                                    util::quoted(candidate.target->id) +
                                    "; they could not be told apart");
      }
    }
  }
}

void TargetFinder::Impl::add(const Target& target, StoredTarget* replaced) {
  // The views take most of the time; what is refused does without them.
  std::vector<TargetPicture> pictures = store.prepare(target, 1);
  requireDifferent(target.id, pictures, replaced);
  if (options.views > 1) pictures = store.prepare(target, options.views);
  if (replaced != nullptr) {
    tracks.forget(*replaced);
    store.remove(*replaced);
  }
  store.add(target, std::move(pictures));
}

void TargetFinder::Impl::tryTarget(StoredTarget& target) {
  target.last_tried = frame_number;
  ++answer.search.tried;
  search.search(target, found);
}

void TargetFinder::Impl::searchFollowed() {
  for (const auto& target : store.targets()) {
    if (tracks.wasSeen(*target)) tryTarget(*target);
  }
}

/// Looks up one part of the keypoints after the other until half of the time has passed; the other
/// half is for the candidates. At least one part is looked up, and the next frame goes on behind
/// the last one. Returns within how many frames all keypoints are looked up at this rate.
std::size_t TargetFinder::Impl::lookUp(std::size_t count, const Budget& budget) {
  constexpr std::size_t kPart = 128;
  std::size_t done = 0;
  while (done < count && (done == 0 || !budget.isOver(0.5))) {
    search.lookUp(turn + done, kPart);
    done += kPart;
  }
  turn = done < count ? (turn + done) % count : 0;
  return done < count ? (count + done - 1) / done : 1;
}

/// Less while something is followed, so that a robot that tracks known targets has time for other
/// work.
double TargetFinder::Impl::timeForOthers() const {
  constexpr double kShareWhileFollowing = 0.1;
  return (found.empty() ? 1.0 : kShareWhileFollowing) * options.search_ms;
}

/// Tries the candidates that were not seen in the last frame until the time has passed: first the
/// one that has waited longest, then the one with most votes, and so on. The first one is always
/// tried.
void TargetFinder::Impl::searchOthers() {
  const Budget budget(timeForOthers());
  const std::size_t frames = lookUp(answer.search.features, budget);
  others.clear();
  for (const Candidate& candidate : search.candidates()) {
    if (candidate.target->last_tried != frame_number) others.push_back(candidate);
  }
  answer.search.candidates = answer.search.tried + others.size();
  in_turn = others;
  std::stable_sort(others.begin(), others.end(),
                   [](const Candidate& a, const Candidate& b) { return a.votes > b.votes; });
  std::stable_sort(in_turn.begin(), in_turn.end(), [](const Candidate& a, const Candidate& b) {
    return a.target->last_tried < b.target->last_tried;
  });
  for (std::size_t i = 0; i < others.size() && (i == 0 || !budget.isOver()); ++i) {
    for (const Candidate& candidate : {in_turn[i], others[i]}) {
      const bool is_tried = candidate.target->last_tried == frame_number;
      if (!is_tried && (i == 0 || !budget.isOver())) tryTarget(*candidate.target);
    }
  }
  answer.search.frames_for_all = frames + answer.search.candidates - answer.search.tried;
}

void TargetFinder::Impl::searchMissing() {
  if (options.search_radius == 0.0) return;
  for (const Track& track : tracks.missing()) {
    StoredTarget* target = store.find(track.target->id);
    search.searchNear(*target, track.picture, targets::predicted(track), found);
  }
}

void TargetFinder::Impl::publish() {
  answer.detections.clear();
  const std::vector<std::uint8_t> is_doubtful = targets::conflicts(found, store);
  for (std::size_t i = 0; i < found.size(); ++i) {
    DetectedTarget detection = detectionOf(found[i], track_of[i], store);
    if (is_doubtful[i] != 0) detection.status = Status::model_rejected;
    answer.detections.push_back(std::move(detection));
  }
  std::sort(answer.detections.begin(), answer.detections.end(),
            [](const DetectedTarget& a, const DetectedTarget& b) {
              return a.id != b.id ? a.id < b.id : a.instance < b.instance;
            });
}

const TargetFrame& TargetFinder::Impl::find(const Features& given, Clock::time_point start) {
  ++frame_number;
  answer.search = {};
  answer.search.known = store.targets().size();
  answer.search.features = given.size();
  answer.search.extraction_milliseconds = millisecondsSince(start);
  found.clear();
  store.index().optimise();
  search.setFrame(given);
  tracks.beginFrame();
  searchFollowed();
  searchOthers();
  track_of.clear();
  tracks.assign(found, store, track_of);
  const auto count = static_cast<std::ptrdiff_t>(found.size());
  searchMissing();
  tracks.assign({found.begin() + count, found.end()}, store, track_of);
  publish();
  tracks.endFrame();
  answer.search.milliseconds = millisecondsSince(start);
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

void TargetFinder::setSearch(double search_ms, double search_radius) {
  TargetFinderOptions changed = impl_->options;
  changed.search_ms = search_ms;
  changed.search_radius = search_radius;
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
  impl_->tracks.forget(*target);
  impl_->store.remove(*target);
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

const TargetFrame& TargetFinder::find(const cv::Mat& image) {
  const Clock::time_point start = Clock::now();
  impl_->extractor.extract(image, impl_->features);
  return impl_->find(impl_->features, start);
}

const TargetFrame& TargetFinder::find(const Features& features) {
  requireValid(features, "frame");
  if (features.descriptor != impl_->options.orb.descriptor) {
    throw std::invalid_argument(std::string("the frame has ") + toString(features.descriptor) +
                                " descriptors; expected " +
                                toString(impl_->options.orb.descriptor));
  }
  return impl_->find(features, Clock::now());
}

const TargetFrame& TargetFinder::findAlone(const cv::Mat& image) {
  const targets::Tracks followed = impl_->tracks;
  const double search_ms = impl_->options.search_ms;
  const auto restore = [&] {
    impl_->tracks = followed;
    impl_->options.search_ms = search_ms;
  };
  impl_->tracks.clear();
  impl_->options.search_ms = std::numeric_limits<double>::infinity();
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
  impl_->tracks.clear();
}

}  // namespace ktgp_orb
