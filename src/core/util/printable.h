#pragma once

#include <cstdio>
#include <string>

namespace ktgp_orb {

/// Text of others (ids, paths, reasons) for a log, an answer or a terminal: on one line, without
/// control characters, and cut after `most` bytes.
inline std::string printable(const std::string& text, std::size_t most = 600) {
  std::string line;
  for (const char c : text) {
    if (line.size() >= most) return line + "...";
    const auto byte = static_cast<unsigned char>(c);
    char escaped[8] = {c, 0};
    if (byte < 0x20 || byte == 0x7f) std::snprintf(escaped, sizeof escaped, "\\x%02x", byte);
    line += c == '\n' ? "\\n" : c == '\0' ? "\\0" : escaped;
  }
  return line;
}

}  // namespace ktgp_orb
