#include "parameters/parameters.h"

#include <algorithm>
#include <charconv>
#include <locale>
#include <map>
#include <sstream>
#include <stdexcept>

#include "util/format.h"

namespace ktgp_orb {
namespace {

/// Returns the names in a text that describes choices: for example, a and b for "a: text; b: text".
std::vector<std::string> namesOfChoices(const std::string& choices) {
  std::vector<std::string> names;
  std::istringstream entries(choices);
  for (std::string entry; std::getline(entries >> std::ws, entry, ';');) {
    names.push_back(entry.substr(0, entry.find(':')));
  }
  return names;
}

#define KTGP_GROUP(name) group = #name;
#define KTGP_BOOL(name, value, about, ...) rows.push_back({group, #name, Kind::boolean, about});
#define KTGP_INT(name, value, low, high, unit, about, ...) \
  rows.push_back({group, #name, Kind::whole, about, unit, Limits(low, high)});
#define KTGP_DOUBLE(name, value, low, high, unit, about, ...) \
  rows.push_back({group, #name, Kind::number, about, unit, Limits(low, high)});
#define KTGP_STRING(name, value, about, ...) rows.push_back({group, #name, Kind::text, about});
#define KTGP_CHOICE(name, value, about, choices, ...) \
  rows.push_back({group, #name, Kind::text, about, "", {}, namesOfChoices(choices)});

using Kind = ParameterInfo::Kind;
using Table = std::vector<ParameterInfo>;

std::map<std::string, Table> readTables() {
  std::map<std::string, Table> tables;
  std::string group;
  {
    Table& rows = tables["matcher"];
#include "parameters/table.def"
  }
  {
    Table& rows = tables["mosaic"];
#include "parameters/mosaic.def"
  }
  {
    Table& rows = tables["stabilizer"];
#include "parameters/stabilizer.def"
  }
  {
    Table& rows = tables["targets"];
#include "parameters/targets.def"
  }
  {
    Table& rows = tables["ground_motion"];
#include "parameters/ground_motion.def"
  }
#include "parameters/table_end.def"
  return tables;
}

std::vector<ParameterRow> readRows() {
  std::vector<ParameterRow::Field> fields;
#define KTGP_ROW(name, value, ...) fields.emplace_back(&Parameters::name);
#include "parameters/each_row.def"
#include "parameters/table.def"
#include "parameters/table_end.def"
  std::vector<ParameterRow> rows;
  // Keep this variable: if parametersOf() got a temporary string, GCC 13 and 14 would warn of a
  // dangling reference.
  const std::string matcher = "matcher";
  for (const ParameterInfo& info : parametersOf(matcher)) {
    rows.push_back({info, fields[rows.size()]});
  }
  return rows;
}

[[noreturn]] void refuse(const ParameterInfo& info, const std::string& name,
                         const std::string& value) {
  throw std::invalid_argument(name + " is " + (value.empty() ? "empty" : value) + "; expected " +
                              info.expected());
}

/// Reads the whole text as a number, independent of the locale. Returns false if it is not a
/// number.
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
  for (const int digits : {6, 15, 17}) {  // take the shortest text that gives the same number
    out.str("");
    out.precision(digits);
    out << value;
    double again = 0.0;
    if (parse(out.str(), again) && again == value) break;
  }
  return out.str();
}

void require(const ParameterInfo& /*info*/, bool /*value*/) {}
template <typename Value>
void require(const ParameterInfo& info, const Value& value) {
  requireValid(info, info.name, value);
}

}  // namespace

Limits::Limits(double low, double high)
    : text_("[" + textOf(low) + ", " + textOf(high) + "]"), low_(low), high_(high) {}

bool Limits::contains(double value) const {
  return value >= low_ && value <= high_;
}

const std::vector<ParameterRow>& parameterRows() {
  static const std::vector<ParameterRow> rows = readRows();
  return rows;
}

const ParameterRow* findParameter(const std::string& name) {
  for (const ParameterRow& row : parameterRows()) {
    if (row.name == name) return &row;
  }
  return nullptr;
}

std::string ParameterInfo::expected() const {
  if (kind == Kind::boolean) return "true or false";
  if (kind == Kind::text) return choices.empty() ? "a text" : util::joined(choices, " or ");
  return (kind == Kind::whole ? "a whole number in " : "a number in ") + limits.text();
}

const std::vector<ParameterInfo>& parametersOf(const std::string& nodelet) {
  static const std::map<std::string, Table> tables = readTables();
  const auto found = tables.find(nodelet);
  if (found != tables.end()) return found->second;
  throw std::invalid_argument("there is no nodelet " + nodelet + " with parameters");
}

const ParameterInfo& parameterOf(const std::string& nodelet, const std::string& name) {
  for (const ParameterInfo& info : parametersOf(nodelet)) {
    if (info.name == name) return info;
  }
  throw std::invalid_argument("the nodelet " + nodelet + " has no parameter " + name);
}

void requireValid(const ParameterInfo& info, const std::string& name, double value) {
  if (!info.limits.contains(value)) refuse(info, name, textOf(value));
}

void requireValid(const ParameterInfo& info, const std::string& name, const std::string& value) {
  const auto& choices = info.choices;
  if (choices.empty() || std::find(choices.begin(), choices.end(), value) != choices.end()) return;
  refuse(info, name, value);
}

void setParameter(const ParameterRow& row, const std::string& text, Parameters& parameters) {
  std::visit(
      [&](auto field) {
        auto value = parameters.*field;
        if (!parse(text, value)) refuse(row, row.name, text);
        require(row, value);
        parameters.*field = value;
      },
      row.field);
}

std::string valueText(const ParameterRow& row, const Parameters& parameters) {
  return std::visit([&](auto field) { return textOf(parameters.*field); }, row.field);
}

void requireValid(const Parameters& parameters) {
  for (const ParameterRow& row : parameterRows()) {
    std::visit([&](auto field) { require(row, parameters.*field); }, row.field);
  }
}

}  // namespace ktgp_orb
