#include "growth/verdict.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "util/cells.h"
#include "util/constants.h"

namespace ktgp_orb::growth {
namespace {

constexpr std::array<double, 2> kShifts{20.0, 45.0};  // px
constexpr int kDirections = 24;
constexpr double kAboveLargest = 1.5;  // minimum ratio to the match rate of each shifted copy
constexpr double kElsewhere = 10.0;    // px; a match with a smaller error contradicts nothing
constexpr double kRounds = 10.0;       // maximum number of rounds of a growth (see GrowthPlan)
// Side of a cell, px; two descriptor patches at this distance share half of their width.
constexpr float kCell = 12.F;
constexpr std::uint64_t kEmpty = ~std::uint64_t{0};

/// log10 of the number of ways to choose four of n pairs.
double logQuadruples(double n) {
  double sum = 0.0;
  for (int i = 0; i < 4; ++i) sum += std::log10(std::max(n - i, 1.0) / (i + 1.0));
  return sum;
}

cv::Point2f shiftOf(int direction, double length) {
  const double angle = 2.0 * util::kPi * direction / kDirections;
  return {static_cast<float>(length * std::cos(angle)),
          static_cast<float>(length * std::sin(angle))};
}

/// Number of cells with matches minus four, because a homography can be fitted to any four pairs.
double evidence(const Grown& grown) {
  return static_cast<double>(grown.judgement.matched) - 4.0;
}

}  // namespace

double logChance(double count, double mean, double spread) {
  constexpr double kPoisson = 1.0 + 1e-6;
  if (!(count > mean)) return 0.0;
  if (mean <= 0.0) return -std::numeric_limits<double>::infinity();
  double exponent = count * std::log(count / mean) - count + mean;
  if (spread > kPoisson) {
    const double size = mean / (spread - 1.0);  // size of the negative binomial distribution
    exponent = count * std::log(count * (mean + size) / (mean * (count + size))) +
               size * std::log((mean + size) / (count + size));
  }
  return -exponent / std::log(10.0);
}

bool Verdict::isNew(const LocalFrame& frame, std::vector<std::uint64_t>& cells) {
  const auto cell = [](float v) {
    return static_cast<std::uint32_t>(static_cast<std::int32_t>(std::floor(v / kCell)));
  };
  const std::uint64_t key = (std::uint64_t{cell(frame.x)} << 32) | cell(frame.y);
  const std::size_t mask = cells.size() - 1;
  std::size_t slot = ((key * 0x9e3779b97f4a7c15U) >> 32) & mask;
  while (cells[slot] != kEmpty && cells[slot] != key) slot = (slot + 1) & mask;
  if (cells[slot] == key) return false;
  cells[slot] = key;
  return true;
}

Verdict::Counts Verdict::count(const std::vector<LocalMatch>& matches,
                               const ReferenceFrames& reference, const LocalMatcher& matcher) {
  std::size_t slots = 16;
  while (slots < 2 * matches.size()) slots *= 2;
  Counts counts{};
  std::size_t level = 0;
  for (const float radius : kRadii) {
    reference_cells_.assign(slots, kEmpty);
    target_cells_.assign(slots, kEmpty);
    double sum = 0.0;
    // Largest Hamming distance counted so far. Matches with smaller distances are counted first, so
    // the best match of a cell counts.
    int above = -1;
    for (const int limit : kDistances) {
      for (const LocalMatch& m : matches) {
        if (m.distance <= above || m.distance > limit) continue;
        if (m.squared_error > radius * radius) continue;
        const bool is_new_reference =
            isNew(reference.frames()[static_cast<std::size_t>(m.reference)], reference_cells_);
        const bool is_new_target = isNew(matcher.frame(m.target), target_cells_);
        if (is_new_reference && is_new_target) sum += 1.0;
      }
      above = limit;
      counts[level++] = sum;
    }
  }
  return counts;
}

Judgement Verdict::judge(const std::vector<Prediction>& predictions,
                         const ReferenceFrames& reference, float first_radius, int seeds,
                         LocalMatcher& matcher, float longest_period) {
  const auto chances = [&](const cv::Point2f& shift) {
    return static_cast<double>(
        matcher.match(predictions, reference.bits(), shift, kRadius, matches_));
  };
  matcher.match(predictions, reference.bits(), {}, first_radius, matches_);
  const double log_tests = std::log10(static_cast<double>(kLevels) * seeds) +
                           logQuadruples(kRounds * static_cast<double>(matcher.candidates()));
  const double own_chances = chances({});
  const Counts own = count(matches_, reference, matcher);

  // We first assume that the decoys have no matches. This test is cheap, and most wrong
  // homographies already fail it.
  const auto matched = static_cast<std::size_t>(own.back());
  Judgement at_best{matched, matched, 0.0, std::numeric_limits<double>::infinity(), 0.0};
  for (const double n : own) {
    at_best.log_false_alarms =
        std::min(at_best.log_false_alarms, log_tests + logChance(n - 4.0, 1.0 / kDecoys, 1.0));
  }
  if (!(at_best.log_false_alarms < kLogMaxFalseAlarms)) return at_best;

  std::size_t d = 0;
  for (const double length : kShifts) {
    for (int direction = 0; direction < kDirections; ++direction, ++d) {
      decoys_[d].chances = chances(shiftOf(direction, length));
      decoys_[d].counts = count(matches_, reference, matcher);
    }
  }
  largest_.fill(0.0);
  for (const Decoy& decoy : decoys_) include(decoy);
  const Judgement judgement = judgementOf(own, own_chances, log_tests);
  if (!(judgement.log_false_alarms < kLogMaxFalseAlarms)) return judgement;
  compareWithRepeats(predictions, reference, longest_period, matcher);
  return judgementOf(own, own_chances, log_tests);
}

Judgement Verdict::judgementOf(const Counts& own, double own_chances, double log_tests) const {
  Judgement judgement = best(own, own_chances, log_tests, kAboveLargest);
  judgement.log_by_chance = best(own, own_chances, log_tests, 0.0).log_false_alarms;
  return judgement;
}

/// Returns the judgement at the level (limits of distance and error) with the fewest false alarms,
/// among the levels at which the homography has more than `above` times the matches of every
/// shifted copy.
Judgement Verdict::best(const Counts& own, double own_chances, double log_tests,
                        double above) const {
  Judgement judgement;
  judgement.matched = static_cast<std::size_t>(own.back());
  judgement.log_false_alarms = std::numeric_limits<double>::infinity();
  for (std::size_t k = 0; k < own.size(); ++k) {
    const Chance chance = chanceAt(k);
    const double mean = chance.rate * own_chances;
    const bool is_unique = own[k] > above * largest_[k] * own_chances;
    const double log_chance = logChance(own[k] - 4.0, mean, chance.spread);
    if (!is_unique || log_tests + log_chance >= judgement.log_false_alarms) continue;
    judgement.support = static_cast<std::size_t>(own[k]);
    judgement.by_chance = mean;
    judgement.log_false_alarms = log_tests + log_chance;
  }
  return judgement;
}

void Verdict::findRepeats(const std::vector<Prediction>& predictions,
                          const std::vector<Bits>& reference, const LocalMatcher& matcher) {
  constexpr float kReach = 120.F;   // px
  constexpr float kBin = 6.F;       // px
  constexpr float kOwn = 10.F;      // px; smaller shifts come from the homography's own matches
  constexpr int kMaxDistance = 64;  // Hamming distance
  constexpr int kSide = static_cast<int>(2 * kReach / kBin);
  constexpr std::size_t kMost = 16;
  bin_votes_.assign(static_cast<std::size_t>(kSide) * kSide, 0);
  bin_sums_.assign(bin_votes_.size(), {});
  for (const Prediction& prediction : predictions) {
    const Bits& bits = reference[static_cast<std::size_t>(prediction.reference)];
    matcher.visitAlike(prediction.frame, kReach, [&](float dx, float dy, const Bits& other) {
      if (distance(bits, other) > kMaxDistance) return;
      const int column = std::clamp(static_cast<int>((dx + kReach) / kBin), 0, kSide - 1);
      const int row = std::clamp(static_cast<int>((dy + kReach) / kBin), 0, kSide - 1);
      const int place = row * kSide + column;
      const auto bin = static_cast<std::size_t>(place);
      ++bin_votes_[bin];
      bin_sums_[bin] += cv::Point2f(dx, dy);
    });
  }
  bin_order_.resize(bin_votes_.size());
  std::iota(bin_order_.begin(), bin_order_.end(), std::size_t{0});
  std::partial_sort(bin_order_.begin(), bin_order_.begin() + 2 * kMost, bin_order_.end(),
                    [&](std::size_t a, std::size_t b) {
                      return bin_votes_[a] != bin_votes_[b] ? bin_votes_[a] > bin_votes_[b] : a < b;
                    });
  repeats_.clear();
  for (std::size_t i = 0; i < 2 * kMost && repeats_.size() < kMost; ++i) {
    const std::size_t bin = bin_order_[i];
    if (bin_votes_[bin] == 0) break;
    const auto votes = static_cast<float>(bin_votes_[bin]);
    const cv::Point2f shift(bin_sums_[bin].x / votes, bin_sums_[bin].y / votes);
    if (shift.dot(shift) > kOwn * kOwn) repeats_.push_back(shift);
  }
}

void Verdict::compareWithRepeats(const std::vector<Prediction>& predictions,
                                 const ReferenceFrames& reference, float longest_period,
                                 LocalMatcher& matcher) {
  findRepeats(predictions, reference.bits(), matcher);
  for (const cv::Point2f& shift : repeats_) {
    if (std::hypot(shift.x, shift.y) > longest_period) continue;
    const auto chances =
        static_cast<double>(matcher.match(predictions, reference.bits(), shift, kRadius, matches_));
    include({chances, count(matches_, reference, matcher)});
  }
}

void Verdict::include(const Decoy& decoy) {
  // A decoy with fewer opportunities than this is treated as if it had this many; otherwise a
  // single match would count too much.
  constexpr double kFewChances = 5.0;
  for (std::size_t k = 0; k < kLevels; ++k) {
    largest_[k] = std::max(largest_[k], decoy.counts[k] / std::max(decoy.chances, kFewChances));
  }
}

/// In a repetitive scene the shift of a decoy may equal one period. A few decoys then have many
/// matches that are not due to chance. So the counts of the kRepeats decoys with the most matches
/// are limited to kBeyond above the largest count of the other decoys. The homography must still
/// have clearly more matches than every decoy (kAboveLargest).
Verdict::Chance Verdict::chanceAt(std::size_t k) const {
  constexpr std::size_t kRepeats = kDecoys / 12;  // number of decoys whose shift may be a period
  // Number of matches by which a decoy may exceed the other decoys by chance.
  constexpr double kBeyond = 2.0;
  Chance chance{0.0, 1.0};
  std::array<double, kDecoys> counts;
  // The sum starts at 1, since events that were not observed are still possible (Laplace's rule).
  double sum = 1.0;
  double all_chances = 1.0;
  for (std::size_t d = 0; d < kDecoys; ++d) {
    counts[d] = decoys_[d].counts[k];
  }
  std::nth_element(counts.begin(), counts.end() - kRepeats - 1, counts.end());
  const double most = *(counts.end() - kRepeats - 1) + kBeyond;
  for (const Decoy& decoy : decoys_) {
    sum += std::min(decoy.counts[k], most);
    all_chances += decoy.chances;
  }
  chance.rate = sum / all_chances;
  // Sum over the decoys of the squared deviation from the expected number, divided by this number.
  double squares = 0.0;
  for (const Decoy& decoy : decoys_) {
    const double expected = chance.rate * std::max(decoy.chances, 1.0);
    const double excess = std::min(decoy.counts[k], most) - expected;
    squares += excess * excess / expected;
  }
  chance.spread = std::max(1.0, squares / double{kDecoys});
  return chance;
}

double agreement(const Grown& rival, const Grown& grown) {
  std::size_t agreeing = 0;
  for (std::size_t i = 0; i < rival.pairs.size(); ++i) {
    agreeing +=
        reprojectionError(grown.map, rival.pairs.reference[i], rival.pairs.target[i]) < kElsewhere;
  }
  return static_cast<double>(agreeing) / static_cast<double>(rival.pairs.size());
}

bool contradicts(const Grown& rival, const Grown& grown, const cv::Size& target,
                 std::vector<std::uint8_t>& covered) {
  constexpr double kDeviations = 2.0;  // in standard deviations; a larger difference is significant
  // The rival contradicts only if more than 1 / kShare of its matches contradict `grown`.
  constexpr std::size_t kShare = 4;
  constexpr double kSide = 32.0;  // side of a cell, px
  const double difference = evidence(grown) - evidence(rival);
  const double both = std::max(evidence(grown) + evidence(rival), 0.0);
  if (difference > kDeviations * std::sqrt(both)) return false;
  const util::Cells cells(target, kSide);
  const auto covered_at = [&](const Eigen::Vector2d& place) -> std::uint8_t& {
    return covered[cells.at(place.x(), place.y())];
  };
  covered.assign(cells.count(), 0);
  for (const Eigen::Vector2d& place : grown.pairs.target) covered_at(place) = 1;
  std::size_t contrary = 0;
  for (std::size_t i = 0; i < rival.pairs.size(); ++i) {
    const Eigen::Vector2d& to = rival.pairs.target[i];
    contrary += covered_at(to) != 0 &&
                !(reprojectionError(grown.map, rival.pairs.reference[i], to) < kElsewhere);
  }
  return kShare * contrary > rival.pairs.size();
}

}  // namespace ktgp_orb::growth
