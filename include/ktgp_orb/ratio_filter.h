#pragma once

#include <cstddef>
#include <vector>

#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/features.h"

namespace ktgp_orb {

/// The ratio threshold T_w of the paper, which uses ORB descriptors.
constexpr double kDefaultRatioThreshold = 0.66;

/// Default T_w for a kind of descriptors: the paper's value for orb, and 0.8 for teblid. Both
/// values give the same precision (doc/tuning.md).
double ratioThreshold(DescriptorKind kind);

/// Throws std::invalid_argument unless T_w is in (0, 1].
void requireRatioThreshold(double threshold);

/// Threshold filtering (TF, Eq. 3): raises every correspondence with W = d1/d2 < `threshold` from
/// Level::knn to Level::kt. Returns the number of raised correspondences. If `mutual` is true,
/// raises only mutual nearest pairs (see KnnMatcher::matchMutual). Throws std::invalid_argument
/// unless `threshold` T_w is in (0, 1]. T_w = 1 removes only the ambiguous matches, whose two
/// nearest neighbours are equally near.
std::size_t filterByRatio(double threshold, std::vector<Correspondence>& correspondences,
                          bool mutual = false);

}  // namespace ktgp_orb
