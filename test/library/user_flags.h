#pragma once

#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::test {

double errorInAUsersProgram(const Eigen::Matrix3d& homography, const Eigen::Vector2d& reference,
                            const Eigen::Vector2d& target);
double ratioInAUsersProgram(const Correspondence& correspondence);

}  // namespace ktgp_orb::test
