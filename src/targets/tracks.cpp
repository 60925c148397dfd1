#include "targets/tracks.h"

#include <algorithm>
#include <tuple>
#include <utility>

#include "homography/transform.h"

namespace ktgp_orb::targets {
namespace {

constexpr std::size_t kNone = static_cast<std::size_t>(-1);

/// Returns a new track that begins with the detection; its instance number is not set yet.
Track trackOf(const FoundTarget& found, TargetStore& store) {
  const cv::Size size = store.picture(found.picture).image.size();
  Track track;
  track.target = found.target;
  track.picture = found.picture;
  track.age = 1;
  track.map = found.estimate.homography;
  track.middle = homography::project(track.map, middleOf(size));
  const cv::Size2d seen = sizeIn(track.map, size);
  track.extent = 0.5 * std::max(seen.width, seen.height);
  track.is_matched = true;
  return track;
}

}  // namespace

void Tracks::setScale(double scale) {
  const double by = scale / std::exchange(scale_, scale);
  if (by == 1.0) return;
  // At both scales, the first pixel has its centre at (0, 0), and its outer corner at (-0.5, -0.5).
  // Resizing keeps this corner in place, so it shifts the centre.
  const Eigen::Vector2d shift = Eigen::Vector2d::Constant(0.5 * (by - 1.0));
  Eigen::Matrix3d resize = Eigen::Matrix3d::Identity();
  resize.topLeftCorner<2, 2>() *= by;
  resize.topRightCorner<2, 1>() = shift;
  for (Track& track : tracks_) {
    track.map = (resize * track.map).eval();
    track.middle = by * track.middle + shift;
    track.velocity *= by;
    track.extent *= by;
  }
}

bool Tracks::needsLargerFrame(double side) const {
  return tracks_.empty() || std::any_of(tracks_.begin(), tracks_.end(), [&](const Track& track) {
           return track.unseen > 0 || 2.0 * track.extent < 1.5 * side * scale_;
         });
}

void Tracks::beginFrame() {
  for (Track& track : tracks_) track.is_matched = false;
}

std::vector<Track> Tracks::missing() const {
  std::vector<Track> tracks;
  for (const Track& track : tracks_) {
    if (!track.is_matched && track.unseen == 0) tracks.push_back(track);
  }
  return tracks;
}

bool Tracks::wasSeen(const StoredTarget& target) const {
  return std::any_of(tracks_.begin(), tracks_.end(), [&](const Track& track) {
    return track.target == &target && track.unseen == 0;
  });
}

void Tracks::assign(const std::vector<FoundTarget>& found, TargetStore& store,
                    std::vector<Track>& tracks) {
  // distance, px; index of the track; index of the detection
  using Pair = std::tuple<double, std::size_t, std::size_t>;
  std::vector<Track> seen;
  std::vector<Pair> pairs;
  seen.reserve(found.size());
  for (const FoundTarget& one : found) seen.push_back(trackOf(one, store));
  for (std::size_t t = 0; t < tracks_.size(); ++t) {
    for (std::size_t i = 0; i < found.size(); ++i) {
      const Track& track = tracks_[t];
      if (track.target != found[i].target || track.is_matched) continue;
      const double distance = (track.middle + track.velocity - seen[i].middle).norm();
      if (distance < std::max(track.extent, seen[i].extent)) pairs.emplace_back(distance, t, i);
    }
  }
  std::sort(pairs.begin(), pairs.end());
  std::vector<std::size_t> track_of(found.size(), kNone);
  for (const auto& [distance, t, i] : pairs) {
    if (tracks_[t].is_matched || track_of[i] != kNone) continue;
    track_of[i] = t;
    tracks_[t].is_matched = true;
  }
  for (std::size_t i = 0; i < found.size(); ++i) {
    if (track_of[i] == kNone) {
      seen[i].instance = freeNumber(*found[i].target);
      track_of[i] = tracks_.size();
      tracks_.push_back(seen[i]);
      continue;
    }
    Track& track = tracks_[track_of[i]];
    seen[i].instance = track.instance;
    if (track.unseen == 0) {
      seen[i].velocity = seen[i].middle - track.middle;
      seen[i].age = track.age + 1;
    }
    track = seen[i];
  }
  for (const std::size_t t : track_of) tracks.push_back(tracks_[t]);
}

int Tracks::freeNumber(const StoredTarget& target) const {
  for (int number = 0;; ++number) {
    const auto has_it = [&](const Track& track) {
      return track.target == &target && track.instance == number;
    };
    if (std::none_of(tracks_.begin(), tracks_.end(), has_it)) return number;
  }
}

void Tracks::endFrame() {
  for (Track& track : tracks_) {
    if (track.is_matched) continue;
    ++track.unseen;
    track.velocity.setZero();
  }
  const auto is_lost = [](const Track& track) { return track.unseen > kMostUnseen; };
  tracks_.erase(std::remove_if(tracks_.begin(), tracks_.end(), is_lost), tracks_.end());
}

void Tracks::forget(const StoredTarget& target) {
  const auto is_of = [&](const Track& track) { return track.target == &target; };
  tracks_.erase(std::remove_if(tracks_.begin(), tracks_.end(), is_of), tracks_.end());
}

Eigen::Matrix3d predicted(const Track& track) {
  Eigen::Matrix3d map = track.map;
  map.row(0) += track.velocity.x() * track.map.row(2);
  map.row(1) += track.velocity.y() * track.map.row(2);
  return map;
}

}  // namespace ktgp_orb::targets
