// Compiles the vector code of the votes once for each instruction set. The best of these is chosen
// at run time. See kernels/dispatch.cpp.
#include "targets/vote_kernel.h"
#include "util/highway_targets.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "targets/vote_dispatch.cpp"
#include <hwy/foreach_target.h>  // includes this file again for each instruction set
#include <hwy/highway.h>

#if KTGP_ORB_HAS_VECTORS
#include "targets/votes-inl.h"
#endif

HWY_BEFORE_NAMESPACE();
namespace ktgp_orb::targets {
namespace HWY_NAMESPACE {

const VoteKernel* voteKernel() {
#if KTGP_ORB_HAS_VECTORS
  static const VoteKernel kernel{hwy::TargetName(HWY_TARGET), votesFor};
  return &kernel;
#else
  return &portableVoteKernel();
#endif
}

}  // namespace HWY_NAMESPACE
}  // namespace ktgp_orb::targets
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace ktgp_orb::targets {
namespace {

HWY_EXPORT(voteKernel);

}  // namespace

const VoteKernel& bestVoteKernel() {
  return *HWY_DYNAMIC_DISPATCH(voteKernel)();
}

}  // namespace ktgp_orb::targets
#endif
