// The pixel loops of ORB with Highway: compiled for every instruction set, chosen at run time.
#include "core/orb/kernels.h"

// The kernels keep vectors in arrays, which needs registers of known size; and processors of SSSE3
// alone are not worth their code.
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128 | HWY_RVV)

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/orb/kernels_simd.cpp"
#include <hwy/foreach_target.h>  // includes this file again for each instruction set
#include <hwy/highway.h>

// Without vectors the plain loops are as good.
#undef KTGP_ORB_VECTORS
#define KTGP_ORB_VECTORS (HWY_TARGET != HWY_SCALAR && HWY_TARGET != HWY_EMU128)
#if KTGP_ORB_VECTORS
#include "core/orb/blur-inl.h"
#include "core/orb/fast-inl.h"
#include "core/orb/patch-inl.h"
#include "core/orb/resize-inl.h"
#endif

HWY_BEFORE_NAMESPACE();
namespace ktgp_orb {
namespace HWY_NAMESPACE {

const OrbKernels* kernels() {
#if KTGP_ORB_VECTORS
  static const OrbKernels kKernels = [] {
    OrbKernels set{hwy::TargetName(HWY_TARGET),
                   resizeRow,
                   mixRows,
                   fastScores,
                   localMaxima,
                   harris,
                   moments,
                   blurAlongRow,
                   blurAcrossRows,
                   describe};
#if !HWY_NATIVE_FMA
    set.blur_along_row = portableOrbKernels().blur_along_row;
    set.blur_across_rows = portableOrbKernels().blur_across_rows;
#endif
    return set;
  }();
  return &kKernels;
#else
  return &portableOrbKernels();
#endif
}

}  // namespace HWY_NAMESPACE
}  // namespace ktgp_orb
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace ktgp_orb {

HWY_EXPORT(kernels);

const OrbKernels& bestOrbKernels() {
  return *HWY_DYNAMIC_DISPATCH(kernels)();
}

std::vector<const OrbKernels*> allOrbKernels() {
  std::vector<const OrbKernels*> all{&portableOrbKernels()};
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
    const OrbKernels* set = HWY_DYNAMIC_DISPATCH(kernels)();
    if (set != all.front()) all.push_back(set);
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  return all;
}

}  // namespace ktgp_orb
#endif
