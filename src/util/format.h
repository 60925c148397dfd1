#pragma once

#include <locale.h>

#include <algorithm>
#include <cstdarg>
#include <cstddef>
#include <cstdio>
#include <opencv2/core/types.hpp>
#include <string>

namespace ktgp_orb::util {

/// Formats text like std::printf and returns it as a string. Numbers have decimal points, also in a
/// program, such as the host of a nodelet, that has set a locale with decimal commas.
__attribute__((format(printf, 1, 2))) inline std::string format(const char* pattern, ...) {
  static const locale_t c_locale = newlocale(LC_NUMERIC_MASK, "C", nullptr);
  const locale_t before = uselocale(c_locale);
  va_list values;
  va_start(values, pattern);
  va_list again;
  va_copy(again, values);
  std::string text(static_cast<std::size_t>(std::vsnprintf(nullptr, 0, pattern, values)), '\0');
  std::vsnprintf(text.data(), text.size() + 1, pattern, again);
  va_end(again);
  va_end(values);
  uselocale(before);
  return text;
}

/// Joins the texts with a separator between them: "a, b, c" for the separator ", ".
template <typename Texts>
std::string joined(const Texts& texts, const char* separator) {
  std::string all;
  for (const std::string& text : texts) all += (all.empty() ? "" : separator) + text;
  return all;
}

/// A size as text, such as "640x480".
inline std::string text(const cv::Size& size) {
  return std::to_string(size.width) + "x" + std::to_string(size.height);
}

/// The name of a tf frame without a leading slash, which tf2 does not allow.
inline std::string withoutSlash(const std::string& frame) {
  return frame.substr(std::min(frame.find_first_not_of('/'), frame.size()));
}

}  // namespace ktgp_orb::util
