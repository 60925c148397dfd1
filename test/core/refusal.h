#pragma once

#include <stdexcept>
#include <string>

namespace ktgp_orb::test {

/// What is said about the argument of the call; empty: it is not refused.
template <typename Call>
std::string refusalOf(const Call& call) {
  try {
    call();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

}  // namespace ktgp_orb::test
