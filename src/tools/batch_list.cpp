#include "tools/batch_list.h"

#include <filesystem>
#include <fstream>
#include <map>

#include "cli/files.h"

namespace ktgp_orb {

std::string batchNameOf(const std::string& input) {
  namespace fs = std::filesystem;
  fs::path path = fs::path(input).lexically_normal();
  if (!path.empty() && *path.begin() == "..") path = fs::absolute(path).lexically_normal();
  std::string name = path.relative_path().string();
  std::size_t at = 0;
  while ((at = name.find_first_of("*?[]", at)) != std::string::npos) name[at] = '_';
  return name;
}

std::vector<ListedRecording> readBatchList(const std::string& file) {
  std::ifstream in(file);
  if (!in) throw tools::FileError(file, "cannot be opened");
  std::vector<ListedRecording> recordings;
  std::map<std::string, std::size_t> rows;
  std::string line;
  for (std::size_t row = 1; std::getline(in, line); ++row) {
    line.erase(line.find_last_not_of(" \t\r") + 1);
    line.erase(0, line.find_first_not_of(" \t"));
    if (line.empty() || line[0] == '#') continue;
    ListedRecording recording{row, line, batchNameOf(line)};
    const auto [first, is_new] = rows.insert({recording.name, row});
    if (!is_new) recording.problem = "is the recording of row " + std::to_string(first->second);
    recordings.push_back(recording);
  }
  if (in.bad()) throw tools::FileError(file, "cannot be read");
  if (recordings.empty()) throw tools::FileError(file, "names no recording; expected one per line");
  return recordings;
}

}  // namespace ktgp_orb
