#include "growth/shift_votes.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <tuple>

#include "growth/verdict.h"
#include "homography/part_in_view.h"

namespace ktgp_orb::growth {
namespace {

// px; a vote that is nearer to a peak than this counts for the peak. Votes scatter, because a
// homography is off by a few px far from its matches.
constexpr double kRadius = 5.0;
constexpr double kApart = 15.0;     // px; nearer peaks count as one peak
constexpr std::size_t kMost = 16;   // maximum number of other peaks
constexpr std::size_t kFewest = 3;  // minimum number of votes of a peak
// A peak with fewer votes may be due to chance, for example if the images differ by a strong tilt.
constexpr double kEvident = 8.0;

std::uint64_t cellOf(const Eigen::Vector2d& p) {
  constexpr double kCell = 12.0;  // px
  const auto part = [](double v) {
    return static_cast<std::uint64_t>(
        static_cast<std::uint32_t>(static_cast<std::int32_t>(std::floor(v / kCell))));
  };
  return (part(p.x()) << 32) | part(p.y());
}

/// Returns a cautious estimate of peak.share(): subtracts one standard deviation, sqrt(votes), from
/// the votes first.
double certainShare(const ShiftVotes::Peak& peak) {
  return std::max(peak.votes - std::sqrt(peak.votes), 0.0) / std::max(peak.seen, 1.0);
}

double countDistinct(std::vector<std::uint64_t>& cells) {
  std::sort(cells.begin(), cells.end());
  return static_cast<double>(std::unique(cells.begin(), cells.end()) - cells.begin());
}

}  // namespace

template <typename Visit>
void ShiftVotes::visitNear(const Eigen::Vector2d& shift, Visit visit) const {
  auto vote = std::lower_bound(votes_.begin(), votes_.end(), shift.x() - kRadius,
                               [](const Vote& v, double x) { return v.shift.x() < x; });
  for (; vote != votes_.end() && vote->shift.x() <= shift.x() + kRadius; ++vote) {
    if ((vote->shift - shift).squaredNorm() < kRadius * kRadius) visit(*vote);
  }
}

ShiftVotes::Peak ShiftVotes::peakAt(const Eigen::Vector2d& shift, const cv::Size& target) {
  Peak peak;
  peak.shift = shift;
  for (auto& cells : cells_) cells.clear();
  visitNear(shift, [&](const Vote& vote) {
    cells_[0].push_back(cellOf(vote.from));
    cells_[1].push_back(cellOf(vote.to));
    peak.centre += vote.from;
  });
  peak.centre /= static_cast<double>(std::max<std::size_t>(cells_[0].size(), 1));
  peak.votes = std::min(countDistinct(cells_[0]), countDistinct(cells_[1]));
  for (const Vote& vote : votes_) {
    const Eigen::Vector2d place = vote.to - vote.shift + shift;
    peak.seen +=
        place.x() > 0.0 && place.y() > 0.0 && place.x() < target.width && place.y() < target.height
            ? 1.0
            : 0.0;
  }
  return peak;
}

void ShiftVotes::findOthers(const cv::Size& target) {
  others_.clear();
  near_.assign(votes_.size(), 0);
  for (std::size_t i = 0; i < votes_.size(); ++i) {
    visitNear(votes_[i].shift, [&](const Vote& /*vote*/) { ++near_[i]; });
  }
  order_.resize(votes_.size());
  std::iota(order_.begin(), order_.end(), std::size_t{0});
  std::sort(order_.begin(), order_.end(), [&](std::size_t a, std::size_t b) {
    return near_[a] != near_[b] ? near_[a] > near_[b] : a < b;
  });
  for (const std::size_t i : order_) {
    if (near_[i] < kFewest || others_.size() == kMost) return;
    const Eigen::Vector2d& shift = votes_[i].shift;
    const auto is_same = [&](const Peak& peak) { return (peak.shift - shift).norm() < kApart; };
    if (is_same(own_) || std::any_of(others_.begin(), others_.end(), is_same)) continue;
    others_.push_back(peakAt(shift, target));
  }
}

void ShiftVotes::count(const Eigen::Matrix3d& map, const PointPairs& pairs,
                       const cv::Size& target) {
  const Eigen::Matrix3d view = homography::facing(map);
  votes_.clear();
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const Eigen::Vector3d p = view * pairs.reference[i].homogeneous();
    if (!(p.z() > 0.0)) continue;
    const Eigen::Vector2d shift = pairs.target[i] - p.hnormalized();
    if (shift.allFinite()) votes_.push_back({shift, pairs.reference[i], pairs.target[i]});
  }
  std::sort(votes_.begin(), votes_.end(), [](const Vote& a, const Vote& b) {
    const auto key = [](const Vote& v) {
      return std::tuple(v.shift.x(), v.shift.y(), v.from.x(), v.from.y());
    };
    return key(a) < key(b);
  });
  own_ = peakAt({0.0, 0.0}, target);
  findOthers(target);
}

// The limit kClear lies between two ratios that were measured on synthetic test images (pages of
// symbols, tables, facades and circuit boards). All shares were reduced by one standard deviation.
// The share of a right homography was at least 2.4 times the share of any other shift, and the
// share of a wrong homography was less than 1.4 times the share of the best other shift.
bool ShiftVotes::isRivalled() const {
  constexpr double kClear = 2.0;
  return std::any_of(others_.begin(), others_.end(), [&](const Peak& other) {
    return other.votes >= kEvident && certainShare(own_) < kClear * certainShare(other);
  });
}

bool ShiftVotes::isEvident() const {
  return own_.votes >= kEvident;
}

bool ShiftVotes::isRepetitive() const {
  return std::any_of(others_.begin(), others_.end(),
                     [](const Peak& other) { return other.votes >= kEvident; });
}

bool ShiftVotes::isClear() const {
  // The own shift is clear if log10 of the probability of so many votes by chance is below this
  // limit. The limit is low because a wrong homography may be the best of hundreds of wrong shifts,
  // for example of all shifts that move a symbol of a page to another symbol.
  constexpr double kLogMost = -5.0;
  // Shifts with fewer votes are ignored: if there are many shifts, some get a few votes by chance.
  constexpr double kCommon = 4.0;
  double share = 0.0;
  for (const Peak& other : others_) {
    if (other.votes >= kCommon) share = std::max(share, certainShare(other));
  }
  return share <= 0.0 || logChance(own_.votes, share * own_.seen, 1.0) < kLogMost;
}

bool ShiftVotes::standsOut() const {
  return isEvident() && isClear();
}

}  // namespace ktgp_orb::growth
