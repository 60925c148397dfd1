// The pixel loops of the alignment with Highway: compiled for every instruction set, chosen at run
// time.
#include "core/alignment/kernels.h"

// The kernels keep vectors in arrays, which needs registers of known size; and processors of SSSE3
// alone are not worth their code.
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128 | HWY_RVV)

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/alignment/kernels_simd.cpp"
#include <hwy/foreach_target.h>  // includes this file again for each instruction set
#include <hwy/highway.h>

// Without vectors the plain loops are as good.
#undef KTGP_ORB_VECTORS
#define KTGP_ORB_VECTORS (HWY_TARGET != HWY_SCALAR && HWY_TARGET != HWY_EMU128)
#if KTGP_ORB_VECTORS
#include "core/alignment/patch-inl.h"
#endif

HWY_BEFORE_NAMESPACE();
namespace ktgp_orb {
namespace HWY_NAMESPACE {

const AlignmentKernels* alignmentKernels() {
#if KTGP_ORB_VECTORS
  static const AlignmentKernels kKernels{hwy::TargetName(HWY_TARGET), warp, prepare, smooth,
                                         compare};
  return &kKernels;
#else
  return &portableAlignmentKernels();
#endif
}

}  // namespace HWY_NAMESPACE
}  // namespace ktgp_orb
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace ktgp_orb {

HWY_EXPORT(alignmentKernels);

const AlignmentKernels& bestAlignmentKernels() {
  return *HWY_DYNAMIC_DISPATCH(alignmentKernels)();
}

std::vector<const AlignmentKernels*> allAlignmentKernels() {
  std::vector<const AlignmentKernels*> all{&portableAlignmentKernels()};
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    hwy::SetSupportedTargetsForTest(target);
    hwy::GetChosenTarget().Update(hwy::SupportedTargets());
    const AlignmentKernels* set = HWY_DYNAMIC_DISPATCH(alignmentKernels)();
    if (set != all.front()) all.push_back(set);
  }
  hwy::SetSupportedTargetsForTest(0);
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  return all;
}

}  // namespace ktgp_orb
#endif
