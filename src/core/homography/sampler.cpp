#include "core/homography/sampler.h"

#include <algorithm>

namespace ktgp_orb::homography {

using util::Random;

void drawDistinct(std::size_t end, std::size_t first, Random& random, ProsacSample& sample) {
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
  constexpr double kSteadyShare = 4.0;  // a quarter of the budget
  const double n = static_cast<double>(points);
  const double m = static_cast<double>(sample_size);
  steady_ = std::min(1.0, budget / (kSteadyShare * n));
  growth_ = std::max(0.0, budget - 1.0 - steady_ * (n - m)) / orderedSamples(points);
}

/// n (n-1) (n-2) … = m! C(n,m)
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
    sample[0] = growth_set_size_ - 1;  // the newest pair; samples without it were drawn earlier
    drawDistinct(growth_set_size_ - 1, 1, random_, sample);
  } else {
    drawDistinct(growth_set_size_, 0, random_, sample);
  }
}

}  // namespace ktgp_orb::homography
