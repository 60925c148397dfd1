#pragma once

#include "features/alignment/kernels.h"
#include "features/orb/kernels.h"
#include "growth/alike_kernel.h"
#include "matching/knn/kernel.h"

namespace ktgp_orb {

/// The inner loops of all stages for one instruction set. Only dispatch.cpp needs all of them; a
/// stage calls its own function, e.g. orb::bestOrbKernels().
struct Kernels {
  alignment::AlignmentKernels alignment;
  growth::AlikeKernel alike;
  knn::KnnKernel knn;
  orb::OrbKernels orb;
};

/// Whether instructions that gather values from memory are faster than reading them one by one: on
/// Intel processors with AVX-512 FP16 (Sapphire Rapids and later). Other processors take up to four
/// times as long, among them older ones from Intel, whose microcode slows gathers down for security
/// (Downfall).
bool hasFastGathers();

}  // namespace ktgp_orb
