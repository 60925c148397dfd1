#pragma once

#include <cstddef>
#include <vector>

#include "growth/votes.h"
#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/features.h"

namespace ktgp_orb::matching {

/// Removes matches that other matches near them do not confirm. Unlike GMS, it needs no grid: the
/// directions and sizes of the two keypoints of a match predict where the matches around it lead
/// (see growth::Votes). So the images may be turned against each other, differ in scale, and have
/// few right matches. The scene may have depth: the matches around may deviate from the prediction
/// by nearly half their distance. Reuses its buffers from call to call.
class Neighbours {
 public:
  /// Lowers the level of each match of Level::ktg that fewer than two matches confirm to
  /// Level::kt. Returns the number of these matches.
  std::size_t drop(const Features& reference, const Features& target,
                   std::vector<Correspondence>& matches);

 private:
  growth::Votes votes_;
};

}  // namespace ktgp_orb::matching
