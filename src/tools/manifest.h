#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "tools/recording.h"

namespace ktgp_orb {

/// What a result was made from. A finished recording is not computed again while this is the same.
struct Origin {
  std::uintmax_t input_size = 0;  ///< bytes; of all files of a pattern
  std::string parameters;         ///< hash
  std::string program;            ///< version
};

/// Bytes of the input; 0 where it cannot be read.
std::uintmax_t sizeOfInput(const std::string& input);

/// 16 hexadecimal digits (FNV-1a, 64 bit).
std::string hashOf(const std::string& text);

/// Writes manifest.json into the folder. Throws FileError.
void writeManifest(const std::string& folder, const std::string& input, const Origin& origin,
                   const Outcome& outcome);

/// The outcome in the folder's manifest; empty without one, or where its origin is another.
std::optional<Outcome> finishedOutcome(const std::string& folder, const Origin& origin);

/// Whether the folder has a manifest.
bool hasManifest(const std::string& folder);

}  // namespace ktgp_orb
