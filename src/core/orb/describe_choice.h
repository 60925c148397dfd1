#pragma once

#include "core/orb/kernels.h"

namespace ktgp_orb::orb {

/// Of the set's two ways to describe, which give the same bits, the one that this processor is
/// faster at. The instruction set does not tell: of two processors that have gather instructions
/// one reads sixteen pixels by them in a quarter of the time that another takes, or that the same
/// one takes after its microcode was mended. So it is tried, which takes a tenth of a millisecond.
OrbKernels::Describe fasterDescribe(const OrbKernels& kernels);

}  // namespace ktgp_orb::orb
