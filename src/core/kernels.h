#pragma once

#include "core/alignment/kernels.h"
#include "core/growth/alike_kernel.h"
#include "core/knn/kernel.h"
#include "core/knn/near_kernel.h"
#include "core/orb/kernels.h"

namespace ktgp_orb {

/// The inner loops of all stages for one instruction set. Only dispatch.cpp needs all of them; a
/// stage calls its own function, e.g. orb::bestOrbKernels().
struct Kernels {
  alignment::AlignmentKernels alignment;
  growth::AlikeKernel alike;
  knn::KnnKernel knn;
  knn::NearKernel near;
  orb::OrbKernels orb;
};

}  // namespace ktgp_orb
