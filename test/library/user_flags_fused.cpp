// Compiled with flags that let the compiler fuse a*b + c.
#include "user_flags.h"

namespace ktgp_orb::test {

double errorInAUsersProgram(const Eigen::Matrix3d& homography, const Eigen::Vector2d& reference,
                            const Eigen::Vector2d& target) {
  return reprojectionError(homography, reference, target);
}

double ratioInAUsersProgram(const Correspondence& correspondence) {
  return correspondence.ratio();
}

}  // namespace ktgp_orb::test
