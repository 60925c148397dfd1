#pragma once

#include <stdexcept>
#include <string>

namespace ktgp_orb::test {

/// What is said of the call; empty: it is not refused.
template <typename Error = std::invalid_argument, typename Call>
std::string refusalOf(const Call& call) {
  try {
    call();
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

}  // namespace ktgp_orb::test
