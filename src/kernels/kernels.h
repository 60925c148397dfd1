#pragma once

#include "features/alignment/kernels.h"
#include "features/orb/kernels.h"
#include "growth/alike_kernel.h"
#include "matching/knn/kernel.h"

namespace ktgp_orb {

/// The inner loops of all stages for one instruction set. Only dispatch.cpp uses this struct; a
/// stage calls the function for its own kernels, e.g. orb::bestOrbKernels().
struct Kernels {
  alignment::AlignmentKernels alignment;
  growth::AlikeKernel alike;
  knn::KnnKernel knn;
  orb::OrbKernels orb;
};

/// Whether gather instructions are faster than reading values one by one. They are faster on Intel
/// processors with AVX-512 FP16 (Sapphire Rapids and later). On other processors, gathers take up
/// to four times as long as single reads; on older Intel processors this is because the microcode
/// slows gathers down for security (Downfall).
bool hasFastGathers();

}  // namespace ktgp_orb
