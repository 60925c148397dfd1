#include "core/homography/stopping.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace ktgp_orb::homography {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kPsi = 0.05;
/// Do not stop for fewer best pairs than this many samples: a few pairs close together agree with
/// models that are wrong elsewhere.
constexpr std::size_t kMinSamplesLong = 5;

/// min_inliers[n] = m + the least j with P(Binomial(n - m, beta) >= j) < psi, for n = m..N. Each
/// step of n needs two products, since j grows by at most one:
///   P(X_{n+1} >= j) = P(X_n >= j) + beta P(X_n = j - 1).
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

/// Probability that a sample from n pairs, `inliers` of them inliers, has only inliers.
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

}  // namespace ktgp_orb::homography
