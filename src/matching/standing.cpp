#include "matching/standing.h"

#include <algorithm>
#include <cmath>

#include "homography/transform.h"
#include "util/keypoint_position.h"

namespace ktgp_orb::matching {
namespace {

using util::position;

// px; a match that moves by less than kStands stands still, and a match that moves by more than
// kMoves moves. Keypoints lie on whole pixels of their pyramid level. So on the finest levels,
// where hot pixels are found, even a still keypoint may move by one pixel along each axis.
constexpr double kStands = 0.7;  // px
constexpr double kMoves = 1.5;   // px; a move by one pixel along both axes is 1.41 px long

/// Side length, px, of a pixel of the pyramid level of the match; the coarser level if the two
/// keypoints have different levels. If the scene moves by less than this length, the keypoints of
/// the level either stand still or move by one whole pixel, all in the same direction.
double pixelOf(const Features& reference, const Features& target, const Correspondence& match) {
  constexpr float kFinest = 31.F;  // size of a keypoint on the finest level, px
  const auto size = [](const Features& features, std::int32_t index) {
    return features.keypoints[static_cast<std::size_t>(index)].size;
  };
  return std::max(
             {kFinest, size(reference, match.reference_index), size(target, match.target_index)}) /
         kFinest;
}

double wayOf(const Features& reference, const Features& target, const Correspondence& match) {
  return (position(target, match.target_index) - position(reference, match.reference_index)).norm();
}

/// Centre of points, and the root mean square of their distances from the centre, px.
struct Spread {
  explicit Spread(const std::vector<Eigen::Vector2d>& points) {
    const double count = std::max(1.0, static_cast<double>(points.size()));
    double squares = 0.0;
    for (const Eigen::Vector2d& point : points) {
      centre += point / count;
      squares += point.squaredNorm() / count;
    }
    size = std::sqrt(std::max(0.0, squares - centre.squaredNorm()));
  }

  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  double size = 0.0;
};

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
    if (way > kMoves * pixelOf(reference, target, c))
      moving_.add(from, position(target, c.target_index), c.ratio());
  }
}

bool Standing::isScene(const std::vector<std::uint8_t>& mask) {
  // Minimum number of moving matches; at most ten agree by chance.
  constexpr std::size_t kLeast = 20;
  // Minimum number of moving matches, as a share of the number of still matches.
  constexpr double kLeastShare = 0.05;
  // Minimum spread of the moving matches, as a share of the spread of the still matches. If the
  // moving matches cover only half of the image, this share is 0.76.
  constexpr double kLeastSpread = 0.75;
  // Maximum distance between the centres of moving and still matches, as a multiple of the spread
  // of the still matches. If the moving matches fill one half of a 16:9 image and the still matches
  // the other half, this distance is at least 0.9.
  constexpr double kFarthest = 0.5;
  agreeing_.clear();
  for (std::size_t i = 0; i < mask.size(); ++i) {
    if (mask[i] != 0) agreeing_.push_back(moving_.reference[i]);
  }
  const auto count = static_cast<double>(agreeing_.size());
  const Spread moving(agreeing_), standing(standing_);
  return agreeing_.size() >= kLeast &&
         count >= kLeastShare * static_cast<double>(standing_.size()) &&
         moving.size > kLeastSpread * standing.size &&
         (moving.centre - standing.centre).norm() < kFarthest * standing.size;
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
