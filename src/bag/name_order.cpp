#include "bag/name_order.h"

#include <algorithm>
#include <cctype>
#include <filesystem>
#include <iterator>
#include <map>
#include <utility>

namespace ktgp_orb::bag {
namespace {

struct Number {
  bool negative = false;
  std::string whole;     ///< digits before the point, leading zeros removed
  std::string fraction;  ///< digits after the point
};

struct Name {
  std::string file;
  std::string ending;
  std::vector<std::string> texts;  ///< lower-case text before each number, and after the last
  std::vector<Number> numbers;
};

bool isDigit(const std::string& text, std::size_t i) {
  return i < text.size() && std::isdigit(static_cast<unsigned char>(text[i])) != 0;
}

/// Returns true for ASCII letters and digits and for all bytes of non-ASCII characters.
bool isLetter(char c) {
  const auto byte = static_cast<unsigned char>(c);
  return byte >= 0x80 || std::isalnum(byte) != 0;
}

std::string takeDigits(const std::string& text, std::size_t& i) {
  const std::size_t begin = i;
  while (isDigit(text, i)) ++i;
  return text.substr(begin, i - begin);
}

std::string withoutZeros(const std::string& digits) {
  return digits.substr(std::min(digits.size(), digits.find_first_not_of('0')));
}

/// Removes a sign from the end of `before`, the text before a number, and returns true if it is a
/// minus. A '-' is a sign in "-5" and "t_-5", but not in "img-5", where it follows a word.
/// `begins`: true if `before` is the beginning of the name.
bool takeSign(bool begins, std::string& before) {
  if (before.empty() || (before.back() != '-' && before.back() != '+')) return false;
  if (before.size() == 1 && !begins) return false;
  const char previous = before.size() > 1 ? before[before.size() - 2] : '/';
  if (isLetter(previous) || previous == '-') return false;
  const bool negative = before.back() == '-';
  before.pop_back();
  return negative;
}

/// Applies a negative exponent to the number. Python writes small decimals such as 1e-05 like this.
void takeExponent(const std::string& text, std::size_t& i, Number& number) {
  constexpr std::size_t kMost = 40;
  if (text.compare(i, 2, "e-") != 0 || !isDigit(text, i + 2)) return;
  std::size_t end = i + 2;
  const std::string digits = takeDigits(text, end);
  const std::size_t places = digits.size() > 2 ? kMost : std::stoul(digits);
  const std::string zeros(places - std::min(places, number.whole.size()), '0');
  const std::string all = zeros + number.whole;
  number.fraction = all.substr(all.size() - places) + number.fraction;
  number.whole = withoutZeros(all.substr(0, all.size() - places));
  i = end;
}

/// Returns true for a decimal point or for a comma, which many languages use instead.
bool isPoint(const std::string& text, std::size_t i) {
  return i < text.size() && (text[i] == '.' || text[i] == ',');
}

/// Returns true if the number is one of three or more numbers with points between them, as in
/// "2024.01.02". Such numbers are counters, not decimals.
bool isInDottedRow(const std::string& text, std::size_t begin, std::size_t end) {
  const bool before = begin >= 2 && isPoint(text, begin - 1) && isDigit(text, begin - 2);
  return before || (isPoint(text, end) && isDigit(text, end + 1));
}

Number takeNumber(const std::string& text, std::size_t& i) {
  Number number;
  const std::size_t begin = i;
  number.whole = withoutZeros(takeDigits(text, i));
  if (isPoint(text, i) && isDigit(text, i + 1)) {
    std::size_t end = i + 1;
    const std::string fraction = takeDigits(text, end);
    if (isInDottedRow(text, begin, end)) return number;
    number.fraction = fraction;
    i = end;
  }
  takeExponent(text, i, number);
  return number;
}

Name nameOf(const std::string& file) {
  Name name{file, std::filesystem::path(file).extension().string(), {}, {}};
  if (name.ending.size() < 2 || isDigit(name.ending, 1)) name.ending.clear();
  const std::string stem = file.substr(0, file.size() - name.ending.size());
  std::string text;
  for (std::size_t i = 0; i < stem.size();) {
    if (!isDigit(stem, i)) {
      text += static_cast<char>(std::tolower(static_cast<unsigned char>(stem[i++])));
      continue;
    }
    const bool negative = takeSign(name.numbers.empty(), text);
    name.numbers.push_back(takeNumber(stem, i));
    name.numbers.back().negative = negative;
    name.texts.push_back(std::exchange(text, ""));
  }
  name.texts.push_back(text);
  return name;
}

int compareCounts(const std::string& a, const std::string& b) {
  if (a.size() != b.size()) return a.size() < b.size() ? -1 : 1;
  return a.compare(b);
}

int compareNumbers(const Number& a, const Number& b, bool are_counts) {
  if (a.negative != b.negative) return a.negative ? -1 : 1;
  int order = compareCounts(a.whole, b.whole);
  if (order == 0) {
    order = are_counts ? compareCounts(withoutZeros(a.fraction), withoutZeros(b.fraction))
                       : a.fraction.compare(b.fraction);
  }
  return a.negative ? -order : order;
}

/// Returns true if the digits after the point are a counter and not decimals. Compares the numbers
/// at position `place` in all names.
bool areCounts(const std::vector<Name>& names, std::size_t place) {
  // A counter has no leading zero, but one in ten decimals has a zero right after the point.
  // Decimals that differ in length have no trailing zero, but one in ten counters ends with a zero.
  // So the digits after the point are counters if a zero is more often their last digit than their
  // first. With kMany or more names, one final zero is not enough, because it may be an exception.
  constexpr std::size_t kMany = 20;
  std::size_t in_front = names.size() < kMany ? 0 : 1;
  std::size_t at_end = 0;
  for (const Name& name : names) {
    if (place >= name.numbers.size() || name.numbers[place].fraction.size() < 2) continue;
    in_front += name.numbers[place].fraction.front() == '0' ? 1 : 0;
    at_end += name.numbers[place].fraction.back() == '0' ? 1 : 0;
  }
  return at_end > in_front;
}

bool isBefore(const Name& a, const Name& b, const std::vector<bool>& are_counts) {
  for (std::size_t i = 0; i < a.texts.size() && i < b.texts.size(); ++i) {
    if (a.texts[i] != b.texts[i]) return a.texts[i] < b.texts[i];
    if (i >= a.numbers.size() || i >= b.numbers.size()) continue;
    const int order = compareNumbers(a.numbers[i], b.numbers[i], are_counts[i]);
    if (order != 0) return order < 0;
  }
  if (a.texts.size() != b.texts.size()) return a.texts.size() < b.texts.size();
  return a.file < b.file;
}

std::vector<Name> namesOf(const std::vector<std::string>& files) {
  std::vector<Name> names;
  std::transform(files.begin(), files.end(), std::back_inserter(names), nameOf);
  return names;
}

}  // namespace

void sortByNumbers(std::vector<std::string>& files) {
  std::vector<Name> names = namesOf(files);
  std::vector<bool> are_counts;
  const auto has_place = [&](const Name& name) { return name.numbers.size() > are_counts.size(); };
  while (std::any_of(names.begin(), names.end(), has_place)) {
    are_counts.push_back(areCounts(names, are_counts.size()));
  }
  std::sort(names.begin(), names.end(),
            [&](const Name& a, const Name& b) { return isBefore(a, b, are_counts); });
  std::transform(names.begin(), names.end(), files.begin(),
                 [](const Name& name) { return name.file; });
}

std::vector<std::string> oddNames(const std::vector<std::string>& files) {
  constexpr std::size_t kFew = 4;
  // A series of names is odd if it has only one file, or at most 1 / kRare of all files.
  constexpr std::size_t kRare = 20;
  std::map<std::vector<std::string>, std::vector<std::string>> alike;
  for (Name& name : namesOf(files)) alike[std::move(name.texts)].push_back(name.file);
  std::size_t most = 0;
  for (const auto& group : alike) most = std::max(most, group.second.size());
  std::vector<std::string> odd;
  if (files.size() < kFew || 2 * most <= files.size()) return odd;
  for (const auto& group : alike) {
    if (group.second.size() > std::max<std::size_t>(1, files.size() / kRare)) continue;
    odd.insert(odd.end(), group.second.begin(), group.second.end());
  }
  return odd;
}

std::vector<std::string> alternatingNames(const std::vector<std::string>& files) {
  constexpr std::size_t kRepeated = 3;  // series with fewer names are ignored
  std::map<std::vector<std::string>, std::size_t> sizes;
  const std::vector<Name> names = namesOf(files);
  for (const Name& name : names) ++sizes[name.texts];
  const Name* before = nullptr;
  std::vector<std::string> first;
  std::size_t changes = 0;
  for (const Name& name : names) {
    if (sizes[name.texts] < kRepeated) continue;
    if (before != nullptr && before->texts != name.texts && changes++ == 0) {
      first = {before->file, name.file};
    }
    before = &name;
  }
  const auto series = static_cast<std::size_t>(std::count_if(
      sizes.begin(), sizes.end(), [](const auto& each) { return each.second >= kRepeated; }));
  return changes > series ? first : std::vector<std::string>{};
}

}  // namespace ktgp_orb::bag
