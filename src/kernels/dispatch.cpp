// The vector code of all stages. This file is compiled once for each instruction set, and the best
// one that the processor supports is chosen at run time.
#include "kernels/kernels.h"
#include "util/highway_targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/dispatch.cpp"
#include <hwy/foreach_target.h>  // includes this file again for each instruction set
#include <hwy/highway.h>

#if KTGP_ORB_HAS_VECTORS
#include "features/alignment/patch-inl.h"
#include "features/orb/blur-inl.h"
#include "features/orb/fast-inl.h"
#include "features/orb/patch-inl.h"
#include "features/orb/resize-inl.h"
#include "features/orb/teblid-inl.h"
#include "growth/alike-inl.h"
#include "matching/knn/near-inl.h"
#include "matching/knn/scan-inl.h"
#endif

HWY_BEFORE_NAMESPACE();
namespace ktgp_orb {
namespace HWY_NAMESPACE {
namespace {

Kernels makeKernels() {
#if KTGP_ORB_HAS_VECTORS
  namespace on_patches = alignment::HWY_NAMESPACE;
  namespace on_pixels = orb::HWY_NAMESPACE;
  namespace on_descriptors = knn::HWY_NAMESPACE;
  const char* const name = hwy::TargetName(HWY_TARGET);
  Kernels set{
      {name, on_patches::warp, on_patches::prepare, on_patches::smooth, on_patches::compare},
      {name, growth::HWY_NAMESPACE::findAlike},
      {name, on_descriptors::kLanes, on_descriptors::scan<false>, on_descriptors::scan<true>,
       on_descriptors::near::search<false>, on_descriptors::near::search<true>},
      {name, on_pixels::resizeRow, on_pixels::mixRows, on_pixels::fastScores,
       on_pixels::localMaxima, on_pixels::harris, on_pixels::moments, on_pixels::blurAlongRow,
       on_pixels::blurAcrossRows, on_pixels::describe, on_pixels::describeTeblidInside}};
#if HWY_ARCH_X86 && HWY_TARGET <= HWY_AVX3_DL
  if (hasFastGathers()) set.orb.describe = on_pixels::describeByGathers;
#endif
#if !HWY_NATIVE_FMA
  // The blur must give the same result on every processor, and it is defined with fused
  // multiply-adds. This instruction set has none, so use the portable loop, which emulates them.
  set.orb.blur_along_row = orb::portableOrbKernels().blur_along_row;
  set.orb.blur_across_rows = orb::portableOrbKernels().blur_across_rows;
#endif
  return set;
#else
  return {alignment::portableAlignmentKernels(), growth::portableAlikeKernel(),
          knn::portableKnnKernel(), orb::portableOrbKernels()};
#endif
}

}  // namespace

const Kernels* kernels() {
  static const Kernels set = makeKernels();
  return &set;
}

}  // namespace HWY_NAMESPACE
}  // namespace ktgp_orb
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
#if HWY_ARCH_X86
#include <cpuid.h>
#endif

namespace ktgp_orb {

bool hasFastGathers() {
#if HWY_ARCH_X86
  unsigned a = 0;
  unsigned b = 0;
  unsigned c = 0;
  unsigned d = 0;
  constexpr unsigned kExtendedFeatures = 7;
  constexpr unsigned kAvx512Fp16 = 1U << 23;  // bit of this feature in register EDX
  return __get_cpuid_count(kExtendedFeatures, 0, &a, &b, &c, &d) != 0 && (d & kAvx512Fp16) != 0;
#else
  return false;
#endif
}

namespace {

HWY_EXPORT(kernels);

/// The kernels of the best instruction set that this processor supports.
const Kernels& bestKernels() {
  return *HWY_DYNAMIC_DISPATCH(kernels)();
}

}  // namespace

const alignment::AlignmentKernels& alignment::bestAlignmentKernels() {
  return bestKernels().alignment;
}

const growth::AlikeKernel& growth::bestAlikeKernel() {
  return bestKernels().alike;
}

const knn::KnnKernel& knn::bestKnnKernel() {
  return bestKernels().knn;
}

const orb::OrbKernels& orb::bestOrbKernels() {
  return bestKernels().orb;
}

}  // namespace ktgp_orb
#endif
