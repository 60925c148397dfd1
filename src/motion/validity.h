#pragma once

#include "ktgp_orb/ground_motion.h"

namespace ktgp_orb::motion {

/// Throws std::invalid_argument if an option is out of range. The message names the option and its
/// range.
void requireValid(const GroundMotionOptions& options);
/// Throws std::invalid_argument if a part of the frame is not usable. The message names this part.
void requireValid(const GroundFrame& frame);
/// Returns true if the covariance is finite and positive definite.
bool isUsable(const Covariance8& covariance);

}  // namespace ktgp_orb::motion
