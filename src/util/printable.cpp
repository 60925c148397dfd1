#include "util/printable.h"

#include <cstdio>

namespace ktgp_orb::util {
namespace {

/// Number of bytes of the printable UTF-8 character that begins at byte `i`; 0 if none begins
/// there.
std::size_t printableAt(const std::string& text, std::size_t i) {
  const auto at = [&text](std::size_t k) {
    return k < text.size() ? static_cast<unsigned char>(text[k]) : 0U;
  };
  const unsigned first = at(i);
  if (first < 0x80) return first >= 0x20 && first != 0x7f ? 1 : 0;
  // U+0080 to U+009F: control characters.
  const bool is_control = first == 0xc2 && at(i + 1) < 0xa0;
  const std::size_t bytes = first >= 0xf0 ? 4 : first >= 0xe0 ? 3 : 2;
  if (first < 0xc2 || first > 0xf4 || is_control) return 0;
  for (std::size_t k = 1; k < bytes; ++k) {
    if ((at(i + k) & 0xc0U) != 0x80) return 0;
  }
  return bytes;
}

}  // namespace

std::string printable(const std::string& text, std::size_t most) {
  std::string shown;
  std::size_t i = 0;
  while (i < text.size() && i < most) {
    const std::size_t bytes = printableAt(text, i);
    if (bytes > 0) {
      shown += text.substr(i, bytes);
    } else {
      char code[8];
      std::snprintf(code, sizeof code, "\\x%02x", static_cast<unsigned char>(text[i]));
      shown += code;
    }
    i += bytes > 0 ? bytes : 1;
  }
  return i < text.size() ? shown + "..." : shown;
}

std::string quoted(const std::string& text) {
  return '"' + printable(text) + '"';
}

}  // namespace ktgp_orb::util
