#include "parameters/target_list.h"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <stdexcept>

namespace ktgp_orb {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void refuse(const std::string& path, const std::string& reason) {
  throw std::invalid_argument(path + ": " + reason);
}

bool isImageName(const fs::path& file) {
  constexpr std::array<const char*, 9> kEndings{".png", ".jpg",  ".jpeg", ".bmp", ".pgm",
                                                ".ppm", ".tiff", ".tif",  ".webp"};
  std::string ending = file.extension().string();
  for (char& c : ending) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return std::find(kEndings.begin(), kEndings.end(), ending) != kEndings.end();
}

std::vector<TargetEntry> readFolder(const std::string& path) {
  std::vector<TargetEntry> entries;
  std::error_code none;
  for (const fs::directory_entry& file : fs::directory_iterator(path)) {
    if (!isImageName(file.path()) || file.is_directory(none)) continue;
    entries.push_back({file.path().stem().string(), {file.path().string()}, 0.0, ""});
  }
  if (entries.empty()) refuse(path, "is a folder without images; expected one for each target");
  std::sort(entries.begin(), entries.end(), [](const TargetEntry& a, const TargetEntry& b) {
    return a.id != b.id ? a.id < b.id : a.files < b.files;
  });
  return entries;
}

TargetEntry entryOf(const YAML::Node& node, const fs::path& folder) {
  TargetEntry entry;
  std::vector<std::string> names;
  for (const auto& item : node) {
    const auto key = item.first.as<std::string>();
    if (key == "id") {
      entry.id = item.second.as<std::string>();
    } else if (key == "image") {
      names = {item.second.as<std::string>()};
    } else if (key == "images") {
      names = item.second.as<std::vector<std::string>>();
    } else if (key == "width") {
      entry.width = item.second.as<double>();
    } else if (key == "frame") {
      entry.frame = item.second.as<std::string>();
    } else {
      throw std::invalid_argument("\"" + key +
                                  "\" is unknown; expected id, image, images, width or frame");
    }
  }
  if (names.empty()) throw std::invalid_argument("it has no image");
  for (const std::string& name : names) entry.files.push_back((folder / name).string());
  if (entry.id.empty()) entry.id = fs::path(names.front()).stem().string();
  return entry;
}

}  // namespace

std::vector<TargetEntry> readTargetList(const std::string& path) {
  std::error_code none;
  if (fs::is_directory(path, none)) return readFolder(path);
  if (!fs::is_regular_file(path, none))
    refuse(path, "is missing; expected a folder or a YAML list");
  std::vector<TargetEntry> entries;
  try {
    const YAML::Node list = YAML::LoadFile(path);
    if (!list.IsSequence()) {
      refuse(path, "is no list of targets; expected lines such as - {id: door, image: door.png}");
    }
    for (const YAML::Node& node : list) {
      const std::string place = "line " + std::to_string(node.Mark().line + 1) + ": ";
      if (!node.IsMap()) refuse(path, place + "expected {id: NAME, image: FILE}");
      try {
        entries.push_back(entryOf(node, fs::path(path).parent_path()));
      } catch (const std::invalid_argument& error) {
        refuse(path, place + error.what());
      }
    }
  } catch (const YAML::Exception& error) {
    refuse(path, std::string("cannot be read as YAML: ") + error.what());
  }
  return entries;
}

void writeTargetList(const std::string& path, const std::vector<TargetEntry>& entries) {
  YAML::Emitter out;
  out.SetDoublePrecision(9);
  out << YAML::BeginSeq;
  for (const TargetEntry& entry : entries) {
    out << YAML::Flow << YAML::BeginMap << YAML::Key << "id" << YAML::Value << entry.id << YAML::Key
        << "images" << YAML::Value << entry.files;
    if (entry.width > 0.0) out << YAML::Key << "width" << YAML::Value << entry.width;
    if (!entry.frame.empty()) out << YAML::Key << "frame" << YAML::Value << entry.frame;
    out << YAML::EndMap;
  }
  out << YAML::EndSeq;
  writeFile(path, out.c_str() + std::string("\n"));
}

void writeFile(const std::string& path, const std::string& bytes) {
  errno = 0;
  std::ofstream file(path, std::ios::binary);
  file << bytes;
  file.close();
  if (file) return;
  const int reason = errno;
  std::error_code none;
  fs::remove(path, none);
  refuse(path, std::string("cannot be written: ") + std::strerror(reason));
}

Target readTarget(const TargetEntry& entry, const ReadImage& read) {
  Target target{entry.id, {}, entry.width, entry.frame};
  for (const std::string& file : entry.files) target.images.push_back(read(file));
  return target;
}

std::vector<std::string> addTargets(const std::vector<TargetEntry>& entries, const ReadImage& read,
                                    TargetFinder& finder) {
  std::vector<std::string> refused;
  for (const TargetEntry& entry : entries) {
    try {
      finder.add(readTarget(entry, read));
    } catch (const std::exception& error) {
      refused.emplace_back(error.what());
    }
  }
  return refused;
}

}  // namespace ktgp_orb
