#pragma once

#include <opencv2/core/types.hpp>
#include <vector>

#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/features.h"
#include "ktgp_orb/gms_filter.h"

namespace ktgp_orb::evaluation {

/// A cell and the cells around it, as (column, row) offsets.
using Neighbourhood = std::vector<cv::Point>;

/// All cells at most `radius` away: 3x3 for 1, 5x5 for 2.
Neighbourhood square(int radius);

/// The cell and its four edge neighbours.
Neighbourhood cross();

/// GMS without rotation and scale, for any neighbourhood. With 3x3 cells it keeps the same matches
/// as GmsFilter. Removes all other entries of `matches`.
void filterByGridStatistics(const Features& reference, const Features& target,
                            const Neighbourhood& neighbourhood, const GmsOptions& options,
                            std::vector<Correspondence>& matches);

}  // namespace ktgp_orb::evaluation
