#include "files/csv.h"

#include "util/format.h"

namespace ktgp_orb::files {

CsvRow& CsvRow::addField(const std::string& field) {
  if (!empty_) text_ += ',';
  empty_ = false;
  text_ += field;
  return *this;
}

CsvRow& CsvRow::add(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return addField(text);
  std::string quoted = "\"";
  for (const char c : text) quoted.append(c == '"' ? 2 : 1, c);
  return addField(quoted + '"');
}

CsvRow& CsvRow::add(double number, int digits) {
  return addField(util::format("%.*g", digits, number));
}

CsvRow& CsvRow::add(const Eigen::Matrix3d& matrix) {
  constexpr int kExact = 17;  // this many digits reproduce every double exactly
  for (int i = 0; i < 9; ++i) add(matrix(i / 3, i % 3), kExact);
  return *this;
}

CsvRow& CsvRow::skip(std::size_t fields) {
  for (std::size_t i = 0; i < fields; ++i) addField("");
  return *this;
}

}  // namespace ktgp_orb::files
