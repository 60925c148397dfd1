#include "tools/manifest.h"

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "bag/video.h"
#include "cli/matcher_cli.h"
#include "cli/output_file.h"

namespace ktgp_orb {
namespace {

std::string manifestIn(const std::string& folder) {
  return folder + "/manifest.json";
}

}  // namespace

std::uintmax_t sizeOfInput(const std::string& input) {
  std::uintmax_t size = 0;
  for (const std::string& file : filesOfInput(input)) {
    std::error_code error;
    const std::uintmax_t its = std::filesystem::file_size(file, error);
    if (!error) size += its;
  }
  return size;
}

std::string hashOf(const std::string& text) {
  std::uint64_t hash = 14695981039346656037U;
  for (const char c : text) hash = (hash ^ static_cast<unsigned char>(c)) * 1099511628211U;
  char digits[17];
  std::snprintf(digits, sizeof digits, "%016llx", static_cast<unsigned long long>(hash));
  return digits;
}

void writeManifest(const std::string& folder, const std::string& input, const Origin& origin,
                   const Outcome& outcome) {
  const nlohmann::json manifest{{"input", input},
                                {"input_size", origin.input_size},
                                {"parameters", origin.parameters},
                                {"program", origin.program},
                                {"exit_code", outcome.exit_code},
                                {"images", outcome.images},
                                {"refused", outcome.refused},
                                {"skipped", outcome.skipped},
                                {"found", outcome.found},
                                {"reason", outcome.reason}};
  tools::writeText(manifestIn(folder), tools::textOf(manifest, 2), true);
}

std::optional<Outcome> finishedOutcome(const std::string& folder, const Origin& origin) {
  std::ifstream in(manifestIn(folder));
  const nlohmann::json manifest = nlohmann::json::parse(in, nullptr, false);
  if (!manifest.is_object()) return std::nullopt;
  try {
    const bool same = manifest.at("input_size") == origin.input_size &&
                      manifest.at("parameters") == origin.parameters &&
                      manifest.at("program") == origin.program;
    if (!same) return std::nullopt;
    return Outcome{manifest.at("exit_code"), manifest.at("images"), manifest.at("refused"),
                   manifest.at("skipped"),   manifest.at("found"),  manifest.at("reason")};
  } catch (const nlohmann::json::exception&) {  // written by something else
    return std::nullopt;
  }
}

bool hasManifest(const std::string& folder) {
  return std::filesystem::exists(manifestIn(folder));
}

}  // namespace ktgp_orb
