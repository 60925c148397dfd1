#include "ktgp_orb/correspondence.h"

#include <algorithm>

namespace ktgp_orb {

double Correspondence::ratio() const {
  return second_distance > 0 ? static_cast<double>(distance) / second_distance : 1.0;
}

std::size_t countAtLeast(const std::vector<Correspondence>& correspondences, Level level) {
  return static_cast<std::size_t>(
      std::count_if(correspondences.begin(), correspondences.end(),
                    [level](const Correspondence& c) { return c.level >= level; }));
}

}  // namespace ktgp_orb
