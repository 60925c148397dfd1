#include "ktgp_orb/ratio_filter.h"

#include <stdexcept>

namespace ktgp_orb {

double ratioThreshold(DescriptorKind kind) {
  return kind == DescriptorKind::teblid ? 0.8 : kDefaultRatioThreshold;
}

void requireRatioThreshold(double threshold) {
  if (threshold > 0.0 && threshold <= 1.0) return;
  throw std::invalid_argument("ratio_threshold is " + std::to_string(threshold) +
                              "; expected a value in (0, 1]");
}

std::size_t filterByRatio(double threshold, std::vector<Correspondence>& correspondences,
                          bool mutual) {
  requireRatioThreshold(threshold);
  std::size_t kept = 0;
  for (Correspondence& c : correspondences) {
    if (mutual && !c.mutual) continue;
    // Compare the ratio of the distances, d1 / d2, with the threshold. The test d1 < threshold * d2
    // could give another result if the two are equal, because its product is rounded differently.
    if (c.level != Level::knn || c.ratio() >= threshold) continue;
    c.level = Level::kt;
    ++kept;
  }
  return kept;
}

}  // namespace ktgp_orb
