#include "core/targets/frame_search.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cstring>
#include <numeric>
#include <utility>

namespace ktgp_orb::targets {
namespace {

// To be tried: among the pairs that stand out among those of all targets.
constexpr std::int32_t kFewestIndexVotes = 2;
// To be grown: among the target's own pairs, which are many.
constexpr std::int32_t kFewestVotes = 5;

}  // namespace

void FrameSearch::setFrame(const Features& features, std::uint64_t number) {
  features_ = &features;
  number_ = number;
  whole_.setFrame(features, {}, features.images);
  frames_.clear();
  bits_.clear();
  hits_.clear();
  for (std::size_t i = 0; i < features.size(); ++i) {
    frames_.push_back(growth::frameOf(features.keypoints[i]));
    bits_.push_back(growth::bitsOf(features, i));
  }
  tables_.setFrame(bits_);
  // Near the golden ratio, so that any part of the order is spread over all; without a common
  // divisor, so that all have a turn.
  step_ = std::max<std::size_t>(1, bits_.size() * 618 / 1000);
  while (std::gcd(step_, bits_.size()) > 1) ++step_;
}

void FrameSearch::lookUp(std::size_t turn, std::size_t count) {
  if (bits_.empty()) return;
  queries_.clear();
  for (std::size_t i = turn; i < turn + std::min(count, bits_.size()); ++i) {
    queries_.push_back(static_cast<std::uint32_t>(i * step_ % bits_.size()));
  }
  store_.index().search(bits_, queries_, hits_);
}

/// The pictures of a target have consecutive numbers, so its hits are a run.
const std::vector<Candidate>& FrameSearch::candidates() {
  std::sort(hits_.begin(), hits_.end(), [](const IndexHit& a, const IndexHit& b) {
    if (a.picture != b.picture) return a.picture < b.picture;
    if (a.distance != b.distance) return a.distance < b.distance;
    return a.query != b.query ? a.query < b.query : a.keypoint < b.keypoint;
  });
  candidates_.clear();
  taken_.clear();
  for (std::size_t begin = 0, end = 0; begin < hits_.size(); begin = end) {
    const std::uint32_t picture = hits_[begin].picture;
    while (end < hits_.size() && hits_[end].picture == picture) ++end;
    seeds_.collect(&hits_[begin], hits_.data() + end, store_.picture(picture).frames, frames_,
                   taken_, kFewestIndexVotes);
    if (seeds_.votes() == 0) continue;
    StoredTarget& target = store_.owner(picture);
    if (candidates_.empty() || candidates_.back().target != &target) {
      candidates_.push_back({&target, 0});
    }
    candidates_.back().votes = std::max(candidates_.back().votes, seeds_.votes());
  }
  return candidates_;
}

void FrameSearch::search(StoredTarget& target, std::vector<FoundTarget>& found) {
  pairs_.resize(std::max(pairs_.size(), target.pictures.size()));
  for (std::size_t i = 0; i < target.pictures.size(); ++i) {
    const std::uint32_t number = target.pictures[i];
    tables_.match(number, store_.picture(number).frames, pairs_[i]);
  }
  taken_.clear();
  FoundTarget result;
  for (int i = 0; i < options_.max_instances && searchOnce(target, result); ++i) {
    found.push_back(result);
    if (i == 0) taken_.assign(features_->size(), 0);
    take(result);
  }
}

/// The first picture in which the target is found, among the keypoints that are not taken.
bool FrameSearch::searchOnce(StoredTarget& target, FoundTarget& result) {
  bool is_rest_set = false;
  for (std::size_t i = 0; i < target.pictures.size(); ++i) {
    const std::uint32_t number = target.pictures[i];
    TargetPicture& picture = store_.picture(number);
    const std::vector<IndexHit>& pairs = pairs_[i];
    seeds_.collect(pairs.data(), pairs.data() + pairs.size(), picture.frames, frames_, taken_,
                   kFewestVotes);
    if (seeds_.votes() == 0) continue;
    if (!taken_.empty() && !std::exchange(is_rest_set, true)) setRest();
    PictureSearch& search = taken_.empty() ? whole_ : rest_;
    if (!search.fromSeeds(picture, seeds_.best(), store_.pictureCount(), result.found)) continue;
    search.align(picture, store_.pyramid(number, number_), *features_, result.found);
    result.target = &target;
    result.picture = number;
    return true;
  }
  return false;
}

void FrameSearch::searchNear(StoredTarget& target, std::uint32_t number,
                             const Eigen::Matrix3d& prediction, std::vector<FoundTarget>& found) {
  taken_.assign(features_->size(), 0);
  bool is_first = true;
  for (const FoundTarget& other : found) {
    if (other.target != &target) continue;
    take(other);
    is_first = false;
  }
  if (!is_first) setRest();
  PictureSearch& search = is_first ? whole_ : rest_;
  FoundTarget result;
  TargetPicture& picture = store_.picture(number);
  if (!search.fromPrediction(picture, prediction, static_cast<float>(options_.search_radius),
                             store_.pictureCount(), result.found)) {
    return;
  }
  search.align(picture, store_.pyramid(number, number_), *features_, result.found);
  result.target = &target;
  result.picture = number;
  result.predicted = true;
  found.push_back(std::move(result));
}

/// The keypoints that it explains, and all others within its outline.
void FrameSearch::take(const FoundTarget& target) {
  const Eigen::Matrix3d& map = target.found.estimate.homography;
  const Eigen::Matrix3d back = map.inverse();
  const cv::Size size = store_.picture(target.picture).image.size();
  for (std::size_t i = 0; i < frames_.size(); ++i) {
    const Eigen::Vector3d p = back * Eigen::Vector3d(frames_[i].x, frames_[i].y, 1.0);
    const Eigen::Vector2d q = p.hnormalized();
    const bool is_inside = q.x() >= 0.0 && q.y() >= 0.0 && q.x() <= size.width - 1.0 &&
                           q.y() <= size.height - 1.0 && map.row(2).dot(q.homogeneous()) > 0.0;
    if (is_inside) taken_[i] = 1;
  }
  for (const std::int32_t i : target.found.keypoints) taken_[static_cast<std::size_t>(i)] = 1;
}

/// The features that are not taken.
void FrameSearch::setRest() {
  rest_numbers_.clear();
  rest_features_.keypoints.clear();
  rest_features_.image_size = features_->image_size;
  rest_features_.descriptor = features_->descriptor;
  for (std::size_t i = 0; i < taken_.size(); ++i) {
    if (taken_[i] != 0) continue;
    rest_numbers_.push_back(static_cast<std::int32_t>(i));
    rest_features_.keypoints.push_back(features_->keypoints[i]);
  }
  rest_features_.descriptors.create(static_cast<int>(rest_numbers_.size()), kDescriptorBytes,
                                    CV_8U);
  for (std::size_t i = 0; i < rest_numbers_.size(); ++i) {
    std::memcpy(rest_features_.descriptors.ptr(static_cast<int>(i)),
                features_->descriptors.ptr(rest_numbers_[i]), kDescriptorBytes);
  }
  rest_.setFrame(rest_features_, rest_numbers_, features_->images);
}

}  // namespace ktgp_orb::targets
