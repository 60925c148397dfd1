#pragma once

#include <utility>

namespace ktgp_orb::util {

/// Resets a result to its initial state, but keeps the memory of one of its buffers, which becomes
/// empty.
template <typename Result, typename Buffer>
void resetKeeping(Buffer Result::*buffer, Result& result) {
  Buffer kept = std::move(result.*buffer);
  kept.clear();
  result = {};
  result.*buffer = std::move(kept);
}

}  // namespace ktgp_orb::util
