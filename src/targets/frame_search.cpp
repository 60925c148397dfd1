#include "targets/frame_search.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cstring>
#include <numeric>
#include <utility>

#include "homography/transform.h"

namespace ktgp_orb::targets {
namespace {

// A target is tried only if its best seed has at least this many votes. The number is low because
// the index returns only the most similar keypoints of all targets, so each target has few wrong
// pairs.
constexpr std::int32_t kFewestIndexVotes = 2;
// When a target is tried, a seed is grown only if it has at least this many votes. The number is
// higher than kFewestIndexVotes because each keypoint of the frame is then paired with the most
// similar keypoint of this one target, so there are many wrong pairs.
constexpr std::int32_t kFewestVotes = 5;
// Like kFewestVotes, but for further instances after one instance of the target was found. It is
// higher because most frames show only one instance.
constexpr std::int32_t kFewestVotesOfOthers = 8;

// The thorough tables are searched only if the best seed has at least this many votes.
constexpr std::int32_t kFewestThoroughVotes = 8;

}  // namespace

void FrameSearch::setFrame(const Features& features, double scale) {
  features_ = &features;
  pyramid_ = {features.images, options_.orb.scale_factor, scale};
  whole_.setFrame(features, {}, pyramid_);
  frames_.clear();
  bits_.clear();
  hits_.clear();
  undetermined_.clear();
  for (std::size_t i = 0; i < features.size(); ++i) {
    frames_.push_back(growth::frameOf(features.keypoints[i]));
    bits_.push_back(growth::bitsOf(features, i));
  }
  tables_.setFrame(bits_);
  is_thorough_set_ = false;
  // From one look-up to the next, the index of the keypoint grows by 0.618 times the number of
  // keypoints (modulo this number), so that the keypoints of one call are spread evenly. The step
  // has no common divisor with the number of keypoints, so every keypoint is reached.
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

/// Sorts the hits by picture, and makes a candidate of each target with enough votes. The pictures
/// of a target have consecutive numbers, so all its hits are next to each other after sorting.
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

/// Searches with the fast tables first, which find most targets. If no instance is found, searches
/// with the thorough tables, but only if a seed had kFewestThoroughVotes votes or more: with fewer
/// votes, these tables seldom help.
int FrameSearch::search(StoredTarget& target, std::vector<FoundTarget>& found) {
  const int count = searchWith(tables_, target, found);
  if (count > 0 || most_votes_ < kFewestThoroughVotes) return count;
  if (!std::exchange(is_thorough_set_, true)) thorough_tables_.setFrame(bits_);
  return searchWith(thorough_tables_, target, found);
}

int FrameSearch::searchWith(FrameTables& tables, StoredTarget& target,
                            std::vector<FoundTarget>& found) {
  pairs_.resize(std::max(pairs_.size(), target.pictures.size()));
  for (std::size_t i = 0; i < target.pictures.size(); ++i) {
    const std::uint32_t number = target.pictures[i];
    tables.match(number, store_.picture(number).frames, pairs_[i]);
  }
  taken_.clear();
  most_votes_ = 0;
  FoundTarget result;
  int count = 0;
  for (; count < options_.max_instances && searchOnce(target, result); ++count) {
    found.push_back(result);
    if (count == 0) taken_.assign(features_->size(), 0);
    take(result);
  }
  return count;
}

/// Searches for the pictures of the target among the keypoints that are not taken. Stops at the
/// first picture that is found.
bool FrameSearch::searchOnce(StoredTarget& target, FoundTarget& result) {
  bool is_rest_set = false;
  for (std::size_t i = 0; i < target.pictures.size(); ++i) {
    const std::uint32_t number = target.pictures[i];
    TargetPicture& picture = store_.picture(number);
    const std::vector<IndexHit>& pairs = pairs_[i];
    seeds_.collect(pairs.data(), pairs.data() + pairs.size(), picture.frames, frames_, taken_,
                   taken_.empty() ? kFewestVotes : kFewestVotesOfOthers);
    if (seeds_.votes() == 0) continue;
    most_votes_ = std::max(most_votes_, seeds_.votes());
    if (!taken_.empty() && !std::exchange(is_rest_set, true)) setRest();
    PictureSearch& search = taken_.empty() ? whole_ : rest_;
    if (!search.fromSeeds(picture, seeds_.best(), store_.pictureCount(), result)) {
      continue;
    }
    search.align(picture, result);
    const bool is_determined = PictureSearch::isDetermined(picture, result);
    if (!search.confirm(picture, store_.pictureCount(), result)) continue;
    result.target = &target;
    result.picture = number;
    if (is_determined) return true;
    undetermined_.push_back(result);
  }
  return false;
}

void FrameSearch::searchNear(StoredTarget& target, std::uint32_t number,
                             const Eigen::Matrix3d& prediction, double radius,
                             std::vector<FoundTarget>& found) {
  FoundTarget result;
  TargetPicture& picture = store_.picture(number);
  if (!whole_.follow(picture, prediction, radius, result) ||
      !PictureSearch::isDetermined(picture, result)) {
    return;
  }
  const auto middle_of = [&](const FoundTarget& one) {
    return homography::project(one.estimate.homography,
                               middleOf(store_.picture(one.picture).image.size()));
  };
  result.target = &target;
  result.picture = number;
  result.predicted = true;
  const Eigen::Vector2d middle = middle_of(result);
  const bool is_there = std::any_of(found.begin(), found.end(), [&](const FoundTarget& other) {
    return other.target == &target && (middle_of(other) - middle).norm() < radius;
  });
  if (!is_there) found.push_back(std::move(result));
}

/// Marks the keypoints that agree with this instance, and all other keypoints within its outline,
/// as taken: the search for the next instance does not use them.
void FrameSearch::take(const FoundTarget& target) {
  const Eigen::Matrix3d& map = target.estimate.homography;
  const Eigen::Matrix3d back = map.inverse();
  const cv::Size size = store_.picture(target.picture).image.size();
  for (std::size_t i = 0; i < frames_.size(); ++i) {
    const Eigen::Vector3d p = back * Eigen::Vector3d(frames_[i].x, frames_[i].y, 1.0);
    const Eigen::Vector2d q = p.hnormalized();
    const bool is_inside = q.x() >= 0.0 && q.y() >= 0.0 && q.x() <= size.width - 1.0 &&
                           q.y() <= size.height - 1.0 && map.row(2).dot(q.homogeneous()) > 0.0;
    if (is_inside) taken_[i] = 1;
  }
  for (const std::int32_t i : target.keypoints) taken_[static_cast<std::size_t>(i)] = 1;
}

/// Passes the features that no instance has taken yet to `rest_`.
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
  rest_.setFrame(rest_features_, rest_numbers_, pyramid_);
}

}  // namespace ktgp_orb::targets
