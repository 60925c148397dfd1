#pragma once

#include <cstddef>

namespace ktgp_orb::util {

/// The name of an enumerator. `names` are in the order of the enumerators, which count from 0 to
/// `kLast`.
template <auto kLast, std::size_t kCount>
const char* nameOf(decltype(kLast) value, const char* const (&names)[kCount]) {
  static_assert(kCount == static_cast<std::size_t>(kLast) + 1, "each enumerator has its name");
  const auto place = static_cast<std::size_t>(value);
  return place < kCount ? names[place] : "unknown";
}

}  // namespace ktgp_orb::util
