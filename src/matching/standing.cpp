#include "matching/standing.h"

#include <algorithm>
#include <cmath>

#include "homography/transform.h"
#include "util/keypoint_position.h"

namespace ktgp_orb::matching {
namespace {

using util::position;

// A keypoint lies on a whole pixel of its level, so one that stands still may move by one in the
// lower levels, where hot pixels are.
constexpr double kStands = 0.7;  // px
constexpr double kMoves = 1.5;   // px

double wayOf(const Features& reference, const Features& target, const Correspondence& match) {
  return (position(target, match.target_index) - position(reference, match.reference_index)).norm();
}

/// Root of the mean square of the distance from the centre, px; 0 for no points.
double spreadOf(const std::vector<Eigen::Vector2d>& points) {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  double squares = 0.0;
  for (const Eigen::Vector2d& point : points) {
    sum += point;
    squares += point.squaredNorm();
  }
  const double count = std::max(1.0, static_cast<double>(points.size()));
  return std::sqrt(std::max(0.0, squares / count - (sum / count).squaredNorm()));
}

}  // namespace

bool Standing::standsStill(const Eigen::Matrix3d& homography, const Features& reference,
                           const Features& target) {
  const cv::Size& size = reference.image_size;
  if (size.empty() || size != target.image_size) return false;
  const homography::FourPoints corners = homography::imageCorners(size, {});
  return std::all_of(corners.begin(), corners.end(), [&](const Eigen::Vector2d& corner) {
    return homography::errorOf(homography, corner, corner) < kStands;
  });
}

void Standing::collect(const Features& reference, const Features& target,
                       const std::vector<Correspondence>& matches) {
  moving_.clear();
  moving_.rounding = util::kKeypointRounding;
  standing_.clear();
  for (const Correspondence& c : matches) {
    if (c.level < Level::ktg) continue;
    const double way = wayOf(reference, target, c);
    const Eigen::Vector2d from = position(reference, c.reference_index);
    if (way < kStands) standing_.push_back(from);
    if (way > kMoves) moving_.add(from, position(target, c.target_index), c.ratio());
  }
}

bool Standing::isScene(const std::vector<std::uint8_t>& mask) {
  constexpr std::size_t kLeast = 20;     // matches; chance gives ten at most
  constexpr double kLeastShare = 0.05;   // of the number of those that stand still
  constexpr double kLeastSpread = 0.75;  // of their spread; half an image has 0.76 of the whole
  agreeing_.clear();
  for (std::size_t i = 0; i < mask.size(); ++i) {
    if (mask[i] != 0) agreeing_.push_back(moving_.reference[i]);
  }
  const double share = kLeastShare * static_cast<double>(standing_.size());
  return agreeing_.size() >= kLeast && static_cast<double>(agreeing_.size()) >= share &&
         spreadOf(agreeing_) > kLeastSpread * spreadOf(standing_);
}

void Standing::drop(const Features& reference, const Features& target,
                    std::vector<Correspondence>& matches) {
  for (Correspondence& c : matches) {
    if (c.level >= Level::kt && !(wayOf(reference, target, c) > kMoves)) {
      c.level = std::min(c.level, Level::kt);
    }
  }
}

std::size_t Standing::count(const Eigen::Matrix3d& homography, const Features& reference,
                            const Features& target, const std::vector<Correspondence>& matches) {
  if (reference.image_size != target.image_size) return 0;
  return static_cast<std::size_t>(
      std::count_if(matches.begin(), matches.end(), [&](const Correspondence& c) {
        if (c.level < Level::kt) return false;
        const Eigen::Vector2d from = position(reference, c.reference_index);
        return wayOf(reference, target, c) < kStands &&
               homography::errorOf(homography, from, from) > 2.0 * kMoves;
      }));
}

}  // namespace ktgp_orb::matching
