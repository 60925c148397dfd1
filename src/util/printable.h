#pragma once

#include <string>

namespace ktgp_orb::util {

/// Text of a stranger, such as an id or the name of a file, for logs, answers and terminals: what
/// is not printable UTF-8 becomes \xNN, and only the first `most` bytes are kept.
std::string printable(const std::string& text, std::size_t most = 200);

/// The printable text in quotes.
std::string quoted(const std::string& text);

}  // namespace ktgp_orb::util
