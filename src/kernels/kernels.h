#pragma once

#include "features/alignment/kernels.h"
#include "features/orb/kernels.h"
#include "growth/alike_kernel.h"
#include "matching/knn/kernel.h"

namespace ktgp_orb {

/// The inner loops of all stages for one instruction set. Only dispatch.cpp uses this struct. A
/// stage gets its own kernels from a function such as orb::bestOrbKernels().
struct Kernels {
  alignment::AlignmentKernels alignment;
  growth::AlikeKernel alike;
  knn::KnnKernel knn;
  orb::OrbKernels orb;
};

/// Returns true if gather instructions are faster than reading the values one by one. This is so on
/// Intel processors with AVX-512 FP16 (Sapphire Rapids and later). On other processors, a gather
/// may take four times as long as single reads; on older Intel processors, a microcode update that
/// closes the security hole Downfall slows gathers down.
bool hasFastGathers();

}  // namespace ktgp_orb
