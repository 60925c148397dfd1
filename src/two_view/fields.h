#pragma once

#include <cmath>

#include "ktgp_orb/two_view.h"

namespace ktgp_orb::two_view {

/// Standard deviation of the distance from the reference camera, in units of the baseline.
inline double distanceDeviation(const ScenePoint& point) {
  const Eigen::Vector3d ray = point.position.normalized();
  return std::sqrt(ray.dot(point.covariance * ray));
}

struct NumberField {
  const char* name;
  const char* text;  ///< meaning, unit, range
};

/// Calls `visit` once for each number of a two-view geometry that messages and files contain. The
/// arguments of `visit` are the NumberField and, for each object of `holders` (TwoView, messages,
/// or none), the member that stores the number.
template <typename Visit, typename... Holders>
void visitNumbers(Visit visit, Holders&... holders) {
  visit(NumberField{"probability",
                    "That the motion is the right one, 0 to 1; the rest is that of "
                    "the other motion. 0 without a motion."},
        holders.probability...);
  visit(NumberField{"parallax",
                    "Median angle between the two rays of an inlier, degrees; NaN without K."},
        holders.parallax...);
  visit(NumberField{"log_false_alarms_homography",
                    "log10 of the number of such homographies that chance would give."},
        holders.log_false_alarms_homography...);
  visit(NumberField{"log_false_alarms_epipolar",
                    "The same for the epipolar geometry; the smaller "
                    "one decides."},
        holders.log_false_alarms_epipolar...);
}

}  // namespace ktgp_orb::two_view
