#include "estimation/prosac.h"

#include <array>
#include <cmath>
#include <cstring>
#include <numeric>
#include <utility>

namespace ktgp_orb::estimation {

namespace {

/// Converts `quality` to an integer with the same order. Rounds it to single precision first, which
/// is precise enough to distinguish all ratios of Hamming distances.
std::uint64_t sortKey(double quality) {
  const float single = static_cast<float>(quality) + 0.0F;  // the sum turns -0 into 0
  std::uint32_t bits = 0;
  std::memcpy(&bits, &single, sizeof bits);
  const bool negative = (bits >> 31) != 0;
  return bits ^ (negative ? 0xffffffffU : 0x80000000U);
}

}  // namespace

/// Sorts with a radix sort that begins at the lowest byte. It is stable, and several times faster
/// than a sort by comparisons.
void QualityOrder::sort(const std::vector<double>& quality) {
  const std::size_t n = quality.size();
  keys_.resize(n);
  sorted_.resize(n);
  for (std::size_t i = 0; i < n; ++i) keys_[i] = sortKey(quality[i]) << kIndexBits | i;
  for (int shift = kIndexBits; shift < 64; shift += 8) {
    std::array<std::size_t, 257> start{};
    for (const std::uint64_t key : keys_) ++start[(key >> shift & 0xffU) + 1];
    std::partial_sum(start.begin(), start.end(), start.begin());
    for (const std::uint64_t key : keys_) sorted_[start[key >> shift & 0xffU]++] = key;
    std::swap(keys_, sorted_);
  }
}

void drawDistinct(std::size_t end, std::size_t first, util::Random& random, ProsacSample& sample) {
  for (std::size_t i = first; i < sample.size(); ++i) {
    const auto drawn = sample.begin() + static_cast<std::ptrdiff_t>(i);
    do {
      sample[i] = random.below(static_cast<std::uint32_t>(end));
    } while (std::find(sample.begin(), drawn, sample[i]) != drawn);
  }
}

ProsacSampler::ProsacSampler(std::size_t sample_size, std::size_t points, int budget,
                             std::uint64_t seed)
    : sample_size_(sample_size),
      points_(points),
      budget_(budget),
      growth_set_size_(sample_size),
      random_(seed) {
  // The r samples for each new pair (see ProsacSampler) use at most 1 / kSteadyShare of the budget.
  constexpr double kSteadyShare = 4.0;
  const double n = static_cast<double>(points);
  const double m = static_cast<double>(sample_size);
  steady_ = std::min(1.0, budget / (kSteadyShare * n));
  growth_ = std::max(0.0, budget - 1.0 - steady_ * (n - m)) / orderedSamples(points);
}

/// Number of ordered samples that can be drawn from n pairs: n (n-1) (n-2) … = m! C(n,m).
double ProsacSampler::orderedSamples(std::size_t n) const {
  const double x = static_cast<double>(n);
  double product = x;
  for (std::size_t i = 1; i < sample_size_; ++i) product *= x - static_cast<double>(i);
  return product;
}

double ProsacSampler::samplesUntil(std::size_t n) const {
  const double added = static_cast<double>(n) - static_cast<double>(sample_size_);
  return 1.0 + steady_ * added + growth_ * orderedSamples(n);
}

void ProsacSampler::draw(std::size_t limit, ProsacSample& sample) {
  ++drawn_;
  limit = std::min(limit, points_);
  const double time = drawn_ * (static_cast<double>(budget_) / (budget_ - spent_));
  while (growth_set_size_ < limit && samplesUntil(growth_set_size_) < time) ++growth_set_size_;
  sample.resize(sample_size_);
  if (samplesUntil(growth_set_size_) >= time) {
    // The sample must include the newest pair; samples without it were drawn earlier.
    sample[0] = growth_set_size_ - 1;
    drawDistinct(growth_set_size_ - 1, 1, random_, sample);
  } else {
    drawDistinct(growth_set_size_, 0, random_, sample);
  }
}

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kPsi = 0.05;
/// The termination length is at least this many times the sample size, because a few pairs that are
/// close together also agree with a model that is wrong in the rest of the image.
constexpr std::size_t kMinSamplesLong = 5;

/// Sets min_inliers[n] = m + the smallest j with P(X_n >= j) < psi, for n = m..N (m: sample size,
/// psi: kPsi). X_n is the number of chance inliers among the n - m pairs beyond the sample, each
/// with probability beta. If n grows by one, j grows by at most one, so the sums of the binomial
/// distribution need not be computed anew: P(X_{n+1} >= j) = P(X_n >= j) + beta P(X_n = j - 1).
void fillMinInliers(std::size_t sample_size, double beta, std::vector<std::size_t>& min_inliers) {
  const double odds = beta / (1.0 - beta);
  double j = 1.0;
  double tail = 0.0;   // P(X >= j)
  double below = 1.0;  // P(X = j - 1)
  for (std::size_t n = sample_size; n < min_inliers.size(); ++n) {
    const double trials = static_cast<double>(n - sample_size);
    if (tail >= kPsi) {
      below *= (trials - j + 1.0) / j * odds;  // P(X = j)
      tail -= below;
      j += 1.0;
    }
    min_inliers[n] = sample_size + static_cast<std::size_t>(j);
    tail += beta * below;
    below *= (1.0 - beta) * (trials + 1.0) / (trials + 2.0 - j);
  }
}

/// Probability that a sample drawn from n pairs has only inliers, if `inliers` of the n pairs are
/// inliers.
double goodSample(int sample_size, double inliers, double n) {
  double p = 1.0;
  for (int i = 0; i < sample_size; ++i) p *= (inliers - i) / (n - i);
  return p;
}

double samplesFor(double good_sample, double log_eta) {
  if (good_sample <= 0.0) return kInfinity;
  if (good_sample >= 1.0) return 1.0;
  return log_eta / std::log1p(-good_sample);
}

}  // namespace

void ProsacStopping::reset(std::size_t sample_size, std::size_t points, double chance_inlier,
                           double confidence) {
  sample_size_ = sample_size;
  log_eta_ = std::log(1.0 - confidence);
  termination_length_ = points;
  samples_needed_ = kInfinity;
  min_inliers_.assign(points + 1, points + 1);
  fillMinInliers(sample_size, chance_inlier, min_inliers_);
}

void ProsacStopping::update(const std::vector<std::uint8_t>& inlier) {
  const std::size_t points = inlier.size();
  const std::size_t shortest = std::min(points, kMinSamplesLong * sample_size_);
  double best = 0.0;
  termination_length_ = points;
  std::size_t inliers = 0;
  for (std::size_t n = 1; n <= points; ++n) {
    inliers += inlier[n - 1];
    if (n < shortest || inliers < min_inliers_[n]) continue;
    const double good = goodSample(static_cast<int>(sample_size_), static_cast<double>(inliers),
                                   static_cast<double>(n));
    if (good <= best) continue;
    best = good;
    termination_length_ = n;
  }
  samples_needed_ = samplesFor(best, log_eta_);
}

}  // namespace ktgp_orb::estimation
