#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace ktgp_orb {

/// Identifies a version of a file: size and time stamp. Zero if there is no file.
struct FileState {
  std::uintmax_t size = 0;
  std::filesystem::file_time_type time{};

  static FileState of(const std::string& path) {
    std::error_code error;
    const auto time = std::filesystem::last_write_time(path, error);
    if (error) return {};
    const std::uintmax_t size = std::filesystem::file_size(path, error);
    if (error) return {};
    return {size, time};
  }

  bool operator==(const FileState& other) const { return size == other.size && time == other.time; }
  bool operator!=(const FileState& other) const { return !(*this == other); }
};

}  // namespace ktgp_orb
