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
                    "Probability that the motion is right, 0 to 1; the other motion has "
                    "the rest. 0 without a motion."},
        holders.probability...);
  visit(NumberField{"parallax",
                    "Median angle between the two rays of an inlier, degrees; NaN without K."},
        holders.parallax...);
  visit(NumberField{"log_false_alarms_homography",
                    "log10 of the expected number of homographies that get the same "
                    "support by chance."},
        holders.log_false_alarms_homography...);
  visit(NumberField{"log_false_alarms_epipolar",
                    "The same for epipolar geometries. An epipolar geometry needs the "
                    "smaller number, and less than -20."},
        holders.log_false_alarms_epipolar...);
}

}  // namespace ktgp_orb::two_view
