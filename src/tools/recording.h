#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

namespace ktgp_orb {

/// What became of a recording.
struct Outcome {
  int exit_code = 0;
  std::size_t images = 0;  ///< matched
  std::uint64_t refused = 0;
  std::uint64_t skipped = 0;  ///< by max_rate
  std::size_t found = 0;      ///< homographies
  std::string reason{};       ///< of an exit code other than 0, in one line
};

}  // namespace ktgp_orb
