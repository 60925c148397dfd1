#pragma once

#include <cstdint>

namespace ktgp_orb {

/// Outcome of matching one frame against its reference. A failure is reported as a value, never as
/// an exception. The values equal the STATUS_ constants in MatchStatus.msg.
enum class Status : std::uint8_t {
  ok = 0,                ///< a homography, or another geometry that the options allow, was found
  no_reference = 1,      ///< there was no reference frame to match against
  too_few_features = 2,  ///< fewer than two reference features or no target feature
  too_few_matches = 3,   ///< fewer than four correspondences were left for the homography
  no_model = 4,          ///< no homography agrees with more pairs than the four of its sample
  model_rejected = 5,    ///< the best homography is degenerate, mirrored, or due to chance
};

/// Returns the enumerator's name, e.g. "too_few_matches".
const char* toString(Status status);

}  // namespace ktgp_orb
