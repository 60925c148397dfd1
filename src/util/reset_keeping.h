#pragma once

#include <utility>

namespace ktgp_orb::util {

/// Resets `result` to its initial state. Its member `buffer` becomes empty, too, but keeps its
/// memory.
template <typename Result, typename Buffer>
void resetKeeping(Buffer Result::*buffer, Result& result) {
  Buffer kept = std::move(result.*buffer);
  kept.clear();
  result = {};
  result.*buffer = std::move(kept);
}

}  // namespace ktgp_orb::util
