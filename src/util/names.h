#pragma once

#include <cstddef>

namespace ktgp_orb::util {

/// The name of the enumerator `value`. `names`: the names of the enumerators 0 to `kLast`, in this
/// order.
template <auto kLast, std::size_t kCount>
const char* nameOf(decltype(kLast) value, const char* const (&names)[kCount]) {
  static_assert(kCount == static_cast<std::size_t>(kLast) + 1, "each enumerator has its name");
  const auto place = static_cast<std::size_t>(value);
  return place < kCount ? names[place] : "unknown";
}

}  // namespace ktgp_orb::util
