#pragma once

#include "core/orb/kernels.h"

namespace ktgp_orb::orb {

/// Returns the faster of the set's two ways to describe, which give the same bits. The instruction
/// set does not determine it: among processors with gather instructions, these can take four times
/// as long on one as on another, or on the same one after a microcode update. So both are tried,
/// which takes a tenth of a millisecond.
OrbKernels::Describe fasterDescribe(const OrbKernels& kernels);

}  // namespace ktgp_orb::orb
