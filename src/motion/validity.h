#pragma once

#include "ktgp_orb/ground_motion.h"

namespace ktgp_orb::motion {

/// Throws std::invalid_argument, which names the option and its range.
void requireValid(const GroundMotionOptions& options);
/// Throws std::invalid_argument, which names the part of the frame that is not usable.
void requireValid(const GroundFrame& frame);
/// Whether the covariance is finite and positive definite.
bool isUsable(const Covariance8& covariance);

}  // namespace ktgp_orb::motion
