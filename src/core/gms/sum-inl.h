// The inner loop of GMS. No include guard: dispatch.cpp includes this once for each instruction
// set.
#include <hwy/highway.h>

#include "core/gms/kernels.h"

HWY_BEFORE_NAMESPACE();
namespace ktgp_orb::gms {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

// The ranges have few entries: lanes past the end are masked out.
std::int32_t sumOfStep(const std::int32_t* steps, const std::int32_t* counts,
                       const std::array<PairRange, 3>& ranges, std::int32_t step) {
  const hn::CappedTag<std::int32_t, kReadBeyond> d;
  const auto wanted = hn::Set(d, step);
  auto sum = hn::Zero(d);
  for (const PairRange& range : ranges) {
    for (std::uint32_t i = range.begin; i < range.end; i += hn::Lanes(d)) {
      const auto inside = hn::FirstN(d, range.end - i);
      const auto counted = hn::And(inside, hn::Eq(hn::LoadU(d, steps + i), wanted));
      sum = hn::Add(sum, hn::IfThenElseZero(counted, hn::LoadU(d, counts + i)));
    }
  }
  return hn::GetLane(hn::SumOfLanes(d, sum));
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace ktgp_orb::gms
HWY_AFTER_NAMESPACE();
