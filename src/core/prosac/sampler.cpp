#include "core/prosac/sampler.h"

#include <algorithm>

namespace ktgp_orb {
namespace {

/// n (n-1) (n-2) (n-3) = 24 C(n,4)
double orderedSamples(std::size_t n) {
  const double x = static_cast<double>(n);
  return x * (x - 1.0) * (x - 2.0) * (x - 3.0);
}

}  // namespace

void drawDistinct(std::size_t end, std::size_t first, Random& random, ProsacSample& sample) {
  for (std::size_t i = first; i < sample.size(); ++i) {
    const auto drawn = sample.begin() + static_cast<std::ptrdiff_t>(i);
    do {
      sample[i] = random.below(static_cast<std::uint32_t>(end));
    } while (std::find(sample.begin(), drawn, sample[i]) != drawn);
  }
}

ProsacSampler::ProsacSampler(std::size_t points, int budget, std::uint64_t seed)
    : points_(points), random_(seed) {
  const double n = static_cast<double>(points);
  steady_ = std::min(1.0, budget / (4.0 * n));
  growth_ = std::max(0.0, budget - 1.0 - steady_ * (n - 4.0)) / orderedSamples(points);
}

double ProsacSampler::samplesUntil(std::size_t n) const {
  return 1.0 + steady_ * (static_cast<double>(n) - 4.0) + growth_ * orderedSamples(n);
}

ProsacSample ProsacSampler::draw(std::size_t limit) {
  ++drawn_;
  limit = std::min(limit, points_);
  while (growth_set_size_ < limit && samplesUntil(growth_set_size_) < drawn_) ++growth_set_size_;
  ProsacSample sample{};
  if (samplesUntil(growth_set_size_) >= drawn_) {
    sample[0] = growth_set_size_ - 1;  // the newest pair; samples without it were drawn before
    drawDistinct(growth_set_size_ - 1, 1, random_, sample);
  } else {
    drawDistinct(growth_set_size_, 0, random_, sample);
  }
  return sample;
}

}  // namespace ktgp_orb
