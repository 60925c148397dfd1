#pragma once

#include <string>

namespace ktgp_orb::util {

/// Makes text from outside, such as an id or a file name, safe for logs, service answers and
/// terminals: bytes that are not printable UTF-8 become \xNN, and only the first `most` bytes are
/// kept.
std::string printable(const std::string& text, std::size_t most = 200);

/// Like printable(), but with quotes around the text.
std::string quoted(const std::string& text);

}  // namespace ktgp_orb::util
