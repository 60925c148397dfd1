#pragma once

#include <gtest/gtest.h>

#include <stdexcept>
#include <string>

namespace ktgp_orb::test {

/// The message of the refused call; empty: it is not refused.
template <typename Error = std::invalid_argument, typename Call>
std::string refusalOf(const Call& call) {
  try {
    call();
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

inline void expectSays(const std::string& text, const std::string& words) {
  EXPECT_NE(text.find(words), std::string::npos) << words << " | " << text;
}

/// With these words.
template <typename Error = std::invalid_argument, typename Call>
void expectRefused(const Call& call, const std::string& words) {
  expectSays(refusalOf<Error>(call), words);
}

}  // namespace ktgp_orb::test
