#include "files/target_list.h"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <filesystem>
#include <set>
#include <stdexcept>

#include "files/input.h"
#include "util/printable.h"

namespace ktgp_orb {
namespace {

namespace fs = std::filesystem;

[[noreturn]] void refuse(const std::string& path, const std::string& reason) {
  throw std::invalid_argument(util::printable(path) + ": " + reason);
}

bool isImageName(const fs::path& file) {
  constexpr std::array<const char*, 9> kEndings{".png", ".jpg",  ".jpeg", ".bmp", ".pgm",
                                                ".ppm", ".tiff", ".tif",  ".webp"};
  std::string ending = file.extension().string();
  for (char& c : ending) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return std::find(kEndings.begin(), kEndings.end(), ending) != kEndings.end();
}

std::string absoluteName(const fs::path& file) {
  std::error_code none;
  const fs::path found = fs::absolute(file, none);
  return none ? file.string() : found.string();
}

std::vector<TargetEntry> readFolder(const std::string& path) {
  std::vector<TargetEntry> entries;
  std::error_code none;
  for (const fs::directory_entry& file : fs::directory_iterator(path)) {
    if (!isImageName(file.path()) || file.is_directory(none)) continue;
    entries.push_back({file.path().stem().string(),
                       {absoluteName(file.path())},
                       0.0,
                       "",
                       util::printable(file.path().string())});
  }
  if (entries.empty()) refuse(path, "is a folder without images; expected one for each target");
  std::sort(entries.begin(), entries.end(), [](const TargetEntry& a, const TargetEntry& b) {
    return a.id != b.id ? a.id < b.id : a.files < b.files;
  });
  return entries;
}

/// Converts a YAML node to `Value`. If this fails, throws std::invalid_argument that names the key
/// and says what was expected.
template <typename Value>
Value valueOf(const std::string& key, const YAML::Node& node, const char* expected) {
  try {
    return node.as<Value>();
  } catch (const YAML::Exception&) {
    throw std::invalid_argument(key + " is no " + expected);
  }
}

TargetEntry entryOf(const YAML::Node& node, const fs::path& folder) {
  TargetEntry entry;
  std::vector<std::string> names;
  std::set<std::string> keys;
  for (const auto& item : node) {
    const auto key = valueOf<std::string>("a key", item.first, "text");
    if (!keys.insert(key).second) throw std::invalid_argument(util::quoted(key) + " occurs twice");
    // YAML's null, an empty value, is not the text "null".
    const bool is_empty = item.second.IsNull();
    if (key == "id") {
      if (is_empty) {
        throw std::invalid_argument(
            "id is empty; expected a name, or no id: the file names it then");
      }
      entry.id = valueOf<std::string>(key, item.second, "text");
    } else if (key == "image") {
      if (is_empty) throw std::invalid_argument("image is empty; expected the name of a file");
      names = {valueOf<std::string>(key, item.second, "name of a file")};
    } else if (key == "images") {
      for (std::size_t i = 0; item.second.IsSequence() && i < item.second.size(); ++i) {
        if (!item.second[i].IsNull()) continue;
        throw std::invalid_argument("a name in images is empty; expected a file");
      }
      names = valueOf<std::vector<std::string>>(key, item.second,
                                                "list of files: [day.png, night.png]");
    } else if (key == "width") {
      entry.width = valueOf<double>(key, item.second, "number of metres");
    } else if (key == "frame") {
      if (!is_empty) entry.frame = valueOf<std::string>(key, item.second, "name of a frame");
    } else {
      throw std::invalid_argument(util::quoted(key) +
                                  " is unknown; expected id, image, images, width or frame");
    }
  }
  if (keys.count("image") + keys.count("images") > 1) {
    throw std::invalid_argument("it has image and images; expected one of them");
  }
  if (names.empty()) throw std::invalid_argument("it has no image");
  for (const std::string& name : names) {
    if (name.empty()) throw std::invalid_argument("the name of an image is empty");
    entry.files.push_back(absoluteName(folder / name));
  }
  if (entry.id.empty()) entry.id = fs::path(names.front()).stem().string();
  return entry;
}

Target readTarget(const TargetEntry& entry) {
  Target target{entry.id, {}, entry.width, entry.frame};
  for (const std::string& file : entry.files) {
    try {
      target.images.push_back(files::readGrey(file));
    } catch (const std::exception& error) {
      throw std::invalid_argument("target " + util::quoted(entry.id) + ": " + error.what());
    }
  }
  return target;
}

}  // namespace

std::vector<TargetEntry> readTargetList(const std::string& path) {
  std::error_code none;
  if (fs::is_directory(path, none)) return readFolder(path);
  if (!fs::exists(path, none)) {
    const bool is_relative = fs::path(path).is_relative();
    refuse(path, "is missing; expected a folder or a YAML list" +
                     (is_relative ? "; it was looked for in " + fs::current_path().string() : ""));
  }
  if (!fs::is_regular_file(path, none)) {
    refuse(path, "is neither a folder nor a file; expected one of them");
  }
  if (isImageName(path)) {
    refuse(path, "is a picture; expected a folder of pictures, or a YAML list of targets");
  }
  std::vector<TargetEntry> entries;
  try {
    const std::vector<YAML::Node> documents = YAML::LoadAllFromFile(path);
    if (documents.size() > 1) refuse(path, "has several YAML documents; expected one list");
    const YAML::Node list = documents.empty() ? YAML::Node() : documents.front();
    if (!list.IsSequence()) {
      refuse(path, "is no list of targets; expected lines such as - {id: door, image: door.png}");
    }
    for (const YAML::Node& node : list) {
      const std::string line = "line " + std::to_string(node.Mark().line + 1);
      if (!node.IsMap()) refuse(path, line + ": expected {id: NAME, image: FILE}");
      try {
        entries.push_back(entryOf(node, fs::path(path).parent_path()));
        entries.back().place = util::printable(path) + ", " + line;
      } catch (const std::invalid_argument& error) {
        refuse(path, line + ": " + error.what());
      }
    }
  } catch (const YAML::Exception& error) {
    refuse(path, std::string("cannot be read as YAML: ") + error.what());
  }
  return entries;
}

std::string textOfTargetList(const std::vector<TargetEntry>& entries) {
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
  return out.c_str() + std::string("\n");
}

void addTarget(const TargetEntry& entry, const std::function<void(const Target&)>& add) {
  try {
    add(readTarget(entry));
  } catch (const std::exception& error) {
    const std::string place = entry.place.empty() ? "" : entry.place + ": ";
    throw std::invalid_argument(place + error.what());
  }
}

std::vector<std::string> addTargets(const std::vector<TargetEntry>& entries, TargetFinder& finder) {
  std::vector<std::string> refused;
  for (const TargetEntry& entry : entries) {
    try {
      addTarget(entry, [&](const Target& target) { finder.add(target); });
    } catch (const std::exception& error) {
      refused.emplace_back(error.what());
    }
  }
  return refused;
}

}  // namespace ktgp_orb
