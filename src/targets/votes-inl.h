// The loop that counts the votes for a seed, as vector code. It has no include guard, because
// vote_dispatch.cpp includes it once for each instruction set.
#include <hwy/highway.h>

#include "targets/vote_kernel.h"

HWY_BEFORE_NAMESPACE();
namespace ktgp_orb::targets {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

const hn::CappedTag<float, kReadBeyond> kFloats;
using Floats = hn::Vec<decltype(kFloats)>;

HWY_INLINE Floats squaredLength(Floats x, Floats y) {
  return hn::Add(hn::Mul(x, x), hn::Mul(y, y));
}

// Computes all conditions of agrees() for several voters at once.
std::int32_t votesFor(const float* columns, std::size_t pitch, std::size_t count,
                      const SeedMap& seed) {
  const auto same = [](float value) { return hn::Set(kFloats, value); };
  std::size_t votes = 0;
  for (std::size_t i = 0; i < count; i += hn::Lanes(kFloats)) {
    const auto value = [&](std::size_t column) {
      return hn::LoadU(kFloats, columns + column * pitch + i);
    };
    const Floats x = hn::Sub(value(0), same(seed.from_x));
    const Floats y = hn::Sub(value(1), same(seed.from_y));
    const Floats squared = squaredLength(x, y);
    const auto is_near = hn::And(hn::Le(squared, same(kVoteReach * kVoteReach)),
                                 hn::Ge(squared, same(kVoteApart * kVoteApart)));
    const auto scales_alike =
        hn::Le(hn::Abs(hn::Sub(value(4), same(seed.log_area))), same(kVoteLogArea));
    const Floats to_x = hn::Sub(value(2), same(seed.to_x));
    const Floats to_y = hn::Sub(value(3), same(seed.to_y));
    const auto is_apart = hn::Ge(squaredLength(to_x, to_y), same(0.25F * kVoteApart * kVoteApart));
    const Floats there_x = hn::Add(hn::Mul(same(seed.xx), x), hn::Mul(same(seed.xy), y));
    const Floats there_y = hn::Add(hn::Mul(same(seed.yx), x), hn::Mul(same(seed.yy), y));
    const Floats slack = hn::Add(
        same(kVoteSlack * kVoteSlack),
        hn::Mul(same(kVoteRelativeSlack * kVoteRelativeSlack), squaredLength(there_x, there_y)));
    const auto is_there =
        hn::Le(squaredLength(hn::Sub(to_x, there_x), hn::Sub(to_y, there_y)), slack);
    const Floats product =
        hn::Add(hn::Add(hn::Add(hn::Mul(value(5), same(seed.xx)), hn::Mul(value(6), same(seed.xy))),
                        hn::Mul(value(7), same(seed.yx))),
                hn::Mul(value(8), same(seed.yy)));
    const auto is_similar =
        hn::Gt(product, hn::Mul(hn::Mul(same(kVoteCosine), value(9)), same(seed.norm)));
    const auto agrees =
        hn::And(hn::And(hn::And(is_near, scales_alike), hn::And(is_apart, is_there)), is_similar);
    votes += hn::CountTrue(kFloats, hn::And(agrees, hn::FirstN(kFloats, count - i)));
  }
  return static_cast<std::int32_t>(votes);
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace ktgp_orb::targets
HWY_AFTER_NAMESPACE();
