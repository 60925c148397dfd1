#include "parameters/near_name.h"

#include <algorithm>
#include <cctype>
#include <cstddef>
#include <numeric>
#include <utility>

namespace ktgp_orb {
namespace {

std::string inSmallLetters(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return text;
}

/// The number of letters to insert, delete or replace that turns `from` into `to` (Levenshtein).
std::size_t changesBetween(const std::string& from, const std::string& to) {
  std::vector<std::size_t> changes(to.size() + 1);  // to the first 0, 1, ... letters of `to`
  std::iota(changes.begin(), changes.end(), std::size_t{0});
  for (const char letter : from) {
    std::size_t replaced = changes[0]++;
    for (std::size_t i = 0; i < to.size(); ++i) {
      replaced += letter == to[i] ? 0 : 1;
      const std::size_t best = std::min({replaced, changes[i] + 1, changes[i + 1] + 1});
      replaced = std::exchange(changes[i + 1], best);
    }
  }
  return changes.back();
}

}  // namespace

std::string hintOnName(const std::string& name, const std::vector<std::string>& names) {
  // A longer text is no name. Its comparison would only take long.
  constexpr std::size_t kLongest = 100;
  if (name.size() > kLongest) return "";
  // The limit is one change for four letters: with one for three, max_latency is like max_rate.
  std::size_t fewest = std::max<std::size_t>(1, name.size() / 4) + 1;
  std::string nearest;
  for (const std::string& known : names) {
    const std::size_t changes = changesBetween(inSmallLetters(name), inSmallLetters(known));
    if (changes >= fewest) continue;
    fewest = changes;
    nearest = known;
  }
  return nearest.empty() ? "" : "; did you mean " + nearest + "?";
}

}  // namespace ktgp_orb
