#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <string>
#include <type_traits>

namespace ktgp_orb::files {

/// Names of the columns for a homography: its elements, row by row.
constexpr const char* kHomographyColumns = "h00,h01,h02,h10,h11,h12,h20,h21,h22";

/// Builds a row of a table as text (csv, RFC 4180). Puts a field in quotes if it contains a comma,
/// a quote or a line break.
class CsvRow {
 public:
  CsvRow& add(const std::string& text);
  CsvRow& add(double number, int digits = 9);
  template <typename Integer, typename = std::enable_if_t<std::is_integral_v<Integer>>>
  CsvRow& add(Integer number) {
    return addField(std::to_string(number));
  }
  /// Adds the nine elements row by row, with enough digits to be exact.
  CsvRow& add(const Eigen::Matrix3d& matrix);
  /// Adds `fields` empty fields.
  CsvRow& skip(std::size_t fields);

  /// The row with a line break at the end.
  std::string line() const { return text_ + '\n'; }

 private:
  CsvRow& addField(const std::string& field);

  std::string text_;
  bool empty_ = true;  // the row has no field yet
};

}  // namespace ktgp_orb::files
