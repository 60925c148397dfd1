// The pixel loops of ORB with Highway: compiled for every instruction set, chosen at run time.
#include "core/orb/kernels.h"
#include "core/util/highway_targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "core/orb/kernels_highway.cpp"
#include <hwy/foreach_target.h>  // includes this file again for each instruction set
#include <hwy/highway.h>

#if KTGP_ORB_HAS_VECTORS
#include "core/orb/blur-inl.h"
#include "core/orb/fast-inl.h"
#include "core/orb/patch-inl.h"
#include "core/orb/resize-inl.h"
#endif

HWY_BEFORE_NAMESPACE();
namespace ktgp_orb::orb {
namespace HWY_NAMESPACE {

const OrbKernels* kernels() {
#if KTGP_ORB_HAS_VECTORS
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
                   describe,
                   describe};
#if HWY_ARCH_X86 && HWY_TARGET <= HWY_AVX2
    set.describe_by_gathers = describeByGathers;
#endif
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
}  // namespace ktgp_orb::orb
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace ktgp_orb::orb {

HWY_EXPORT(kernels);

const OrbKernels& bestOrbKernels() {
  return *HWY_DYNAMIC_DISPATCH(kernels)();
}

}  // namespace ktgp_orb::orb
#endif
