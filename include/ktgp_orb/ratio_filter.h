#pragma once

#include <cstddef>
#include <vector>

#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/features.h"

namespace ktgp_orb {

/// The paper's ratio threshold T_w, of ORB's descriptors.
constexpr double kDefaultRatioThreshold = 0.66;

/// T_w for a kind of descriptors, whose distances spread in their own way: the paper's for orb; 0.8
/// for teblid, where as large a share of the matches is right (doc/tuning.md).
double ratioThreshold(DescriptorKind kind);

/// Threshold filtering (TF, Eq. 3): raises every correspondence with W = d1/d2 < `threshold`,
/// strictly, from Level::knn to Level::kt and returns how many those are. With `mutual` only those
/// of which each is the other's nearest (see KnnMatcher::matchMutual).
/// `threshold` T_w in (0, 1], else std::invalid_argument. T_w = 1 leaves nothing out but those
/// whose two nearest are equally near: which of the two is meant no distance can tell.
std::size_t filterByRatio(double threshold, std::vector<Correspondence>& correspondences,
                          bool mutual = false);

}  // namespace ktgp_orb
