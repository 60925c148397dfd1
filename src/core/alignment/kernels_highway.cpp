// The pixel loops of the alignment with Highway: compiled for every instruction set, chosen at run
// time.
#include "core/alignment/kernels.h"
#include "core/util/highway_targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/alignment/kernels_highway.cpp"
#include <hwy/foreach_target.h>  // includes this file again for each instruction set
#include <hwy/highway.h>

#if KTGP_ORB_HAS_VECTORS
#include "core/alignment/patch-inl.h"
#endif

HWY_BEFORE_NAMESPACE();
namespace ktgp_orb::alignment {
namespace HWY_NAMESPACE {

const AlignmentKernels* alignmentKernels() {
#if KTGP_ORB_HAS_VECTORS
  static const AlignmentKernels kKernels{hwy::TargetName(HWY_TARGET), warp, prepare, smooth,
                                         compare};
  return &kKernels;
#else
  return &portableAlignmentKernels();
#endif
}

}  // namespace HWY_NAMESPACE
}  // namespace ktgp_orb::alignment
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace ktgp_orb::alignment {

HWY_EXPORT(alignmentKernels);

const AlignmentKernels& bestAlignmentKernels() {
  return *HWY_DYNAMIC_DISPATCH(alignmentKernels)();
}

}  // namespace ktgp_orb::alignment
#endif
