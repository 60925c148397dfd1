#pragma once

#include "ktgp_orb/ground_motion.h"

namespace ktgp_orb::motion {

/// Throws std::invalid_argument, which names the option and its range.
void requireValid(const GroundMotionOptions& options);
/// Throws std::invalid_argument, which names what is not usable.
void requireValid(const GroundFrame& frame);
/// Whether it is finite and positive definite.
bool isUsable(const Covariance8& covariance);

}  // namespace ktgp_orb::motion
