#include "parameters/parameters.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <locale>
#include <map>
#include <sstream>
#include <stdexcept>

namespace ktgp_orb {
namespace {

/// "a: text; b: text" -> a, b
std::vector<std::string> namesOfChoices(const std::string& choices) {
  std::vector<std::string> names;
  std::istringstream entries(choices);
  for (std::string entry; std::getline(entries >> std::ws, entry, ';');) {
    names.push_back(entry.substr(0, entry.find(':')));
  }
  return names;
}

std::vector<ParameterRow> readTable() {
  std::vector<ParameterRow> rows;
  std::string group;
#define KTGP_GROUP(name) group = #name;
#define KTGP_BOOL(name, value, text) rows.push_back({group, #name, &Parameters::name, text});
#define KTGP_INT(name, value, low, high, unit, text) \
  rows.push_back({group, #name, &Parameters::name, text, unit, Limits(low, high)});
#define KTGP_DOUBLE(name, value, low, high, unit, text) \
  rows.push_back({group, #name, &Parameters::name, text, unit, Limits(low, high)});
#define KTGP_STRING(name, value, text) rows.push_back({group, #name, &Parameters::name, text});
#define KTGP_CHOICE(name, value, text, choices) \
  rows.push_back({group, #name, &Parameters::name, text, "", {}, namesOfChoices(choices)});
#include "parameters/table.def"
#include "parameters/table_end.def"
  return rows;
}

using Ranges = std::map<std::string, Limits>;

Ranges readRanges(const std::string& nodelet) {
  Ranges ranges;
#define KTGP_GROUP(name)
#define KTGP_BOOL(name, value, text)
#define KTGP_INT(name, value, low, high, unit, text) ranges.emplace(#name, Limits(low, high));
#define KTGP_DOUBLE(name, value, low, high, unit, text) ranges.emplace(#name, Limits(low, high));
#define KTGP_STRING(name, value, text)
#define KTGP_CHOICE(name, value, text, choices)
  if (nodelet == "stabilizer") {
#include "parameters/stabilizer.def"
  } else if (nodelet == "ground_motion") {
#include "parameters/ground_motion.def"
  } else {
#include "parameters/mosaic.def"
  }
#include "parameters/table_end.def"
  return ranges;
}

std::string joined(const std::vector<std::string>& choices) {
  std::string list;
  for (const std::string& choice : choices) list += (list.empty() ? "" : " or ") + choice;
  return list;
}

[[noreturn]] void refuse(const ParameterRow& row, const std::string& value,
                         const std::string& expected) {
  throw std::invalid_argument(row.name + " is " + (value.empty() ? "empty" : value) +
                              "; expected " + expected);
}

std::string expected(const ParameterRow& row) {
  if (std::holds_alternative<bool Parameters::*>(row.field)) return "true or false";
  if (!row.choices.empty()) return joined(row.choices);
  const bool whole = std::holds_alternative<int Parameters::*>(row.field);
  return (whole ? "a whole number in " : "a number in ") + row.limits.text();
}

/// The whole text as a number, in any locale; false if it is not a number.
bool parse(const std::string& text, double& number) {
  std::istringstream in(text);
  in.imbue(std::locale::classic());
  return (in >> number) && in.peek() == std::char_traits<char>::eof();
}

bool parse(const std::string& text, int& number) {
  const char* const end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, number);
  return error == std::errc() && stop == end;
}

bool parse(const std::string& text, bool& value) {
  value = text == "true";
  return value || text == "false";
}

bool parse(const std::string& text, std::string& value) {
  value = text;
  return true;
}

std::string textOf(bool value) {
  return value ? "true" : "false";
}
std::string textOf(int value) {
  return std::to_string(value);
}
std::string textOf(const std::string& value) {
  return value;
}
std::string textOf(double value) {
  std::ostringstream out;
  out.imbue(std::locale::classic());
  for (const int digits : {6, 15, 17}) {  // the shortest text that gives the same number
    out.str("");
    out.precision(digits);
    out << value;
    double again = 0.0;
    if (parse(out.str(), again) && again == value) break;
  }
  return out.str();
}

bool isValid(const ParameterRow& /*row*/, bool /*value*/) {
  return true;
}
bool isValid(const ParameterRow& row, int value) {
  return row.limits.contains(value);
}
bool isValid(const ParameterRow& row, double value) {
  return row.limits.contains(value);
}
bool isValid(const ParameterRow& row, const std::string& value) {
  const auto& choices = row.choices;
  return choices.empty() || std::find(choices.begin(), choices.end(), value) != choices.end();
}

}  // namespace

Limits::Limits(double low, double high)
    : text_("[" + textOf(low) + ", " + textOf(high) + "]"), low_(low), high_(high) {}

bool Limits::contains(double value) const {
  return value >= low_ && value <= high_;
}

const std::vector<ParameterRow>& parameterRows() {
  static const std::vector<ParameterRow> rows = readTable();
  return rows;
}

const ParameterRow* findParameter(const std::string& name) {
  for (const ParameterRow& row : parameterRows()) {
    if (row.name == name) return &row;
  }
  return nullptr;
}

Limits limitsOf(const std::string& nodelet, const std::string& name) {
  return readRanges(nodelet).at(name);
}

void setParameter(const ParameterRow& row, const std::string& text, Parameters& parameters) {
  std::visit(
      [&](auto field) {
        auto value = parameters.*field;
        if (!parse(text, value) || !isValid(row, value)) refuse(row, text, expected(row));
        parameters.*field = value;
      },
      row.field);
}

std::string valueText(const ParameterRow& row, const Parameters& parameters) {
  return std::visit([&](auto field) { return textOf(parameters.*field); }, row.field);
}

void requireValid(const Parameters& parameters) {
  for (const ParameterRow& row : parameterRows()) {
    std::visit(
        [&](auto field) {
          if (!isValid(row, parameters.*field))
            refuse(row, textOf(parameters.*field), expected(row));
        },
        row.field);
  }
}

}  // namespace ktgp_orb
