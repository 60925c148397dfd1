#pragma once

#include <cstdint>

namespace ktgp_orb {

/// Outcome of matching one frame against its reference. Failure is a value, never an exception.
/// The numbers are those of the STATUS_ constants in MatchStatus.msg.
enum class Status : std::uint8_t {
  ok = 0,                ///< a homography was found and is supported by its inliers
  no_reference = 1,      ///< there was no reference frame to match against
  too_few_features = 2,  ///< fewer than two reference features or no target feature
  too_few_matches = 3,   ///< fewer than four correspondences were left for the homography
  no_model = 4,          ///< no sample gave a homography that any other correspondence agrees with
  model_rejected = 5,    ///< the best homography is degenerate, mirrored, or explained by chance
};

/// The enumerator's own name, e.g. "too_few_matches".
const char* toString(Status status);

}  // namespace ktgp_orb
