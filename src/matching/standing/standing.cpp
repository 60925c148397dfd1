#include "matching/standing/standing.h"

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
// Minimum number of moving matches, and of still matches that may mislead their homography; at most
// ten agree by chance.
constexpr std::size_t kLeast = 20;
// Minimum number of the matches of one kind, as a share of the number of the other kind.
constexpr double kLeastShare = 0.05;

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

/// Returns true if the homography clearly moves what is at the given place.
bool isMoved(const Eigen::Matrix3d& homography, const Eigen::Vector2d& place) {
  return homography::errorOf(homography, place, place) > 2.0 * kMoves;
}

/// Centre of points, and the root mean square of their distances from the centre, px, in all and
/// along x and y.
struct Spread {
  explicit Spread(const std::vector<Eigen::Vector2d>& points) {
    const double count = std::max(1.0, static_cast<double>(points.size()));
    Eigen::Array2d squares = Eigen::Array2d::Zero();
    for (const Eigen::Vector2d& point : points) {
      centre += point / count;
      squares += point.array().square() / count;
    }
    along = (squares - centre.array().square()).max(0.0).sqrt();
    size = along.matrix().norm();
  }

  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  Eigen::Array2d along = Eigen::Array2d::Zero();
  double size = 0.0;
};

}  // namespace

bool Standing::collect(const Features& reference, const Features& target,
                       const std::vector<Correspondence>& matches) {
  answer_stands_still_ = false;
  image_size_ = reference.image_size;
  if (image_size_.empty() || image_size_ != target.image_size) return false;
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
  return std::min(standing_.size(), moving_.size()) >= kLeast;
}

/// Number of places of still matches that the homography moves by more than `least` px.
std::size_t Standing::countMoved(const Eigen::Matrix3d& homography, double least) const {
  return static_cast<std::size_t>(
      std::count_if(standing_.begin(), standing_.end(), [&](const Eigen::Vector2d& place) {
        return homography::errorOf(homography, place, place) > least;
      }));
}

bool Standing::mayMislead(const Eigen::Matrix3d& answer, double max_error) {
  const homography::FourPoints corners = homography::imageCorners(image_size_, {});
  answer_stands_still_ =
      std::all_of(corners.begin(), corners.end(), [&](const Eigen::Vector2d& corner) {
        return homography::errorOf(answer, corner, corner) < kStands;
      });
  // Matches that are far from their predicted positions have no influence on the answer.
  return answer_stands_still_ || 2 * countMoved(answer, 2.0 * max_error) <= standing_.size();
}

bool Standing::isScene(const ProsacResult& moving) {
  // Minimum number of moving matches, as a multiple of the number of still matches, if they need
  // not be spread like these.
  constexpr double kClearMajority = 2.0;
  // Minimum spread of the moving matches, as a share of the spread of the still matches. If the
  // moving matches cover only half of the image, this share is 0.76.
  constexpr double kLeastSpread = 0.75;
  // Maximum distance between the centres of moving and still matches along x and y, as a multiple
  // of the spread of the still matches along this axis. If the moving matches fill a band at the
  // border of the image and the still matches the rest, this distance is at least 1.7.
  constexpr double kFarthest = 1.0;
  agreeing_.clear();
  for (std::size_t i = 0; i < moving.mask.size(); ++i) {
    if (moving.mask[i] != 0) agreeing_.push_back(moving_.reference[i]);
  }
  const auto count = static_cast<double>(agreeing_.size());
  const auto still = static_cast<double>(standing_.size());
  if (agreeing_.size() < kLeast) return false;
  if (std::min(count, still) < kLeastShare * std::max(count, still)) return false;

  const std::size_t contradicted = countMoved(moving.answer.homography, 2.0 * kMoves);
  const bool is_contradicted = contradicted >= kLeast && 2 * contradicted >= standing_.size();
  if (answer_stands_still_ && is_contradicted && count > kClearMajority * still) return true;
  if (!answer_stands_still_ && !is_contradicted) return false;
  const Spread spread(agreeing_), of_still(standing_);
  const Eigen::Array2d apart = (spread.centre - of_still.centre).array().abs();
  return spread.size > kLeastSpread * of_still.size && (apart < kFarthest * of_still.along).all();
}

void Standing::lower(const Eigen::Matrix3d& homography, const Features& reference,
                     const Features& target, std::vector<Correspondence>& matches) {
  for (Correspondence& c : matches) {
    if (c.level < Level::kt || wayOf(reference, target, c) > kMoves) continue;
    const Eigen::Vector2d from = position(reference, c.reference_index);
    if (homography::errorOf(homography, from, from) > kMoves) c.level = Level::kt;
  }
}

void Standing::erase(const Eigen::Matrix3d& homography, const Features& reference,
                     const Features& target, std::vector<Correspondence>& matches) {
  const std::size_t still = count(homography, reference, target, matches);
  const auto all = static_cast<double>(matches.size());
  if (still < kLeast || static_cast<double>(still) < kLeastShare * all) return;
  const auto stays = [&](const Correspondence& c) {
    return wayOf(reference, target, c) < kMoves &&
           isMoved(homography, position(reference, c.reference_index));
  };
  matches.erase(std::remove_if(matches.begin(), matches.end(), stays), matches.end());
}

std::size_t Standing::count(const Eigen::Matrix3d& homography, const Features& reference,
                            const Features& target, const std::vector<Correspondence>& matches) {
  if (reference.image_size != target.image_size) return 0;
  return static_cast<std::size_t>(
      std::count_if(matches.begin(), matches.end(), [&](const Correspondence& c) {
        return c.level >= Level::kt && wayOf(reference, target, c) < kStands &&
               isMoved(homography, position(reference, c.reference_index));
      }));
}

}  // namespace ktgp_orb::matching
