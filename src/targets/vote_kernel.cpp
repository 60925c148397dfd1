// The inner loop of the votes in plain C++, the reference for the vector versions.
#include "targets/vote_kernel.h"

namespace ktgp_orb::targets {
namespace {

std::int32_t votesFor(const float* columns, std::size_t pitch, std::size_t count,
                      const SeedMap& seed) {
  std::int32_t votes = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const auto value = [&](std::size_t column) { return columns[column * pitch + i]; };
    const SeedMap voter{value(0), value(1), value(2), value(3), value(4),
                        value(5), value(6), value(7), value(8), value(9)};
    votes += agrees(voter, seed) ? 1 : 0;
  }
  return votes;
}

}  // namespace

const VoteKernel& portableVoteKernel() {
  static constexpr VoteKernel kPortable{"portable", votesFor};
  return kPortable;
}

}  // namespace ktgp_orb::targets
