#include "ktgp_orb/gms_filter.h"

#include "options_check.h"

namespace ktgp_orb {

GmsFilter::GmsFilter(const GmsOptions& options) : options_(options) {
  requireInRange("gms threshold", options.threshold, 0.0, 1e6);
  requireInRange("grid_columns", options.grid_columns, 1, 200);
  requireInRange("grid_rows", options.grid_rows, 1, 200);
}

// Stand-in: keeps every match. The motion statistics follow in their own change.
GmsResult GmsFilter::filter(const Features& /*reference*/, const Features& /*target*/,
                            std::vector<Correspondence>& correspondences) {
  GmsResult result;
  for (Correspondence& c : correspondences) {
    if (c.level != Level::kt) continue;
    c.level = Level::ktg;
    ++result.kept;
  }
  return result;
}

}  // namespace ktgp_orb
