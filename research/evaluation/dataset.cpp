#include "evaluation/dataset.h"

#include <algorithm>
#include <array>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <system_error>

#include "evaluation/truth_points.h"
#include "files/input.h"

namespace ktgp_orb::evaluation {
namespace {

namespace fs = std::filesystem;

constexpr int kImagesPerSet = 6;
constexpr std::array<const char*, 5> kImageEndings{".ppm", ".pgm", ".png", ".jpg", ".jpeg"};

// Both functions also return false for an invalid name, for example a name that is too long.
bool isThere(const fs::path& path) {
  std::error_code none;
  return fs::exists(path, none);
}
bool isFolder(const fs::path& path) {
  std::error_code none;
  return fs::is_directory(path, none);
}

/// File names of a kind of data set.
struct Layout {
  const char* image_prefix;
  const char* homography_prefix;
  const char* separator;
  const char* homography_suffix;

  std::string homography(int i, int k) const {
    return homography_prefix + std::to_string(i) + separator + std::to_string(k) +
           homography_suffix;
  }
};

constexpr Layout kOxford{"img", "H", "to", "p"};
constexpr Layout kHpatches{"", "H_", "_", ""};

/// Image `k` with any of the usual endings, or the first ending if there is no such file.
fs::path imageFile(const fs::path& folder, const Layout& layout, int k) {
  const std::string stem = layout.image_prefix + std::to_string(k);
  for (const char* ending : kImageEndings) {
    if (isThere(folder / (stem + ending))) return folder / (stem + ending);
  }
  return folder / (stem + ".ppm");
}

bool isLaidOutAs(const Layout& layout, const fs::path& folder) {
  return isThere(imageFile(folder, layout, 1)) || isThere(folder / layout.homography(1, 2));
}

bool endsIn(const std::string& text, const std::string& end) {
  return text.size() >= end.size() && text.compare(text.size() - end.size(), end.size(), end) == 0;
}

constexpr const char* kPointsEnding = ".points";

/// Adds the pair, or reports a missing or broken file.
void addPair(ImagePair pair, const std::string& truth, Dataset& dataset) {
  try {
    for (const std::string& file : {pair.reference, pair.target, truth}) {
      files::requireRegularFile(file);
      dataset.files.push_back(file);
    }
    if (endsIn(truth, kPointsEnding)) {
      pair.points = readPoints(truth);
      pair.homography = homographyThrough(pair.points, truth);
    } else {
      pair.homography = files::readHomography(truth);
    }
    dataset.pairs.push_back(std::move(pair));
  } catch (const files::FileError& error) {
    dataset.problems.emplace_back(error.what());
  }
}

void addSet(const fs::path& folder, const Layout& layout, Dataset& dataset) {
  const std::string set = fs::canonical(folder).filename().string();
  for (int i = 1; i < kImagesPerSet; ++i) {
    const std::string reference = imageFile(folder, layout, i).string();
    for (int k = i + 1; k <= kImagesPerSet; ++k) {
      const fs::path homography = folder / layout.homography(i, k);
      if (i > 1 && !isThere(homography)) continue;  // most sets have only homographies of image 1
      const std::string target = imageFile(folder, layout, k).string();
      addPair({set, std::to_string(i) + "-" + std::to_string(k), reference, target, {}, {}, {}},
              homography.string(), dataset);
    }
  }
}

std::vector<fs::path> filesEndingIn(const char* ending, const fs::path& folder) {
  std::vector<fs::path> files;
  if (!isFolder(folder)) return files;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (entry.path().extension() == ending) files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

/// The file `stem` with any of the usual endings of images, or .png if there is no such file.
std::string imageOf(const fs::path& stem) {
  for (const char* ending : kImageEndings) {
    if (isThere(stem.string() + ending)) return stem.string() + ending;
  }
  return stem.string() + ".png";
}

bool addExtremeViews(const fs::path& folder, Dataset& dataset) {
  const std::vector<fs::path> truths = filesEndingIn(".txt", folder / "h");
  if (!isFolder(folder / "1") || !isFolder(folder / "2")) return false;
  const std::string set = fs::canonical(folder).filename().string();
  for (const fs::path& truth : truths) {
    const fs::path name = truth.stem();
    addPair({set,
             name.string(),
             imageOf(folder / "1" / name),
             imageOf(folder / "2" / name),
             {},
             {},
             {}},
            truth.string(), dataset);
  }
  return !truths.empty();
}

bool addAnnotated(const fs::path& folder, Dataset& dataset) {
  const std::vector<fs::path> truths = filesEndingIn(kPointsEnding, folder);
  const std::string set = fs::canonical(folder).filename().string();
  for (const fs::path& truth : truths) {
    const std::string name = truth.stem().string();
    addPair({set, name, imageOf(folder / (name + "A")), imageOf(folder / (name + "B")), {}, {}, {}},
            truth.string(), dataset);
  }
  return !truths.empty();
}

bool addFolder(const fs::path& folder, Dataset& dataset) {
  for (const Layout& layout : {kOxford, kHpatches}) {
    if (!isLaidOutAs(layout, folder)) continue;
    addSet(folder, layout, dataset);
    return true;
  }
  return addExtremeViews(folder, dataset) || addAnnotated(folder, dataset);
}

void addSubfolders(const fs::path& folder, Dataset& dataset) {
  std::vector<fs::path> subfolders;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (entry.is_directory()) subfolders.push_back(entry.path());
  }
  std::sort(subfolders.begin(), subfolders.end());
  bool found = false;
  for (const fs::path& subfolder : subfolders) found |= addFolder(subfolder, dataset);
  if (!found) {
    dataset.problems.push_back(
        folder.string() +
        ": holds no image set; expected img1.ppm and H1to2p, 1.ppm and H_1_2, 1/NAME.png and "
        "h/NAME.txt, or NAMEA.png and NAME.points, in it or in its subfolders");
  }
}

constexpr const char* kRow = "`name imageA imageB truth`";

/// What a file is instead of a list: "is a picture". Empty if it may be a list with mistakes.
std::string otherThanAList(const std::string& file, const std::string& line) {
  const std::string known = files::knownFormat(file);
  const bool is_text = line.find('\0') == std::string::npos;
  return known.empty() && !is_text ? "is not a text file" : known;
}

void addList(const fs::path& file, Dataset& dataset) {
  constexpr int kMostBadLines = 10;
  std::ifstream in(file);
  if (!in) {
    dataset.problems.push_back(file.string() + ": cannot be opened");
    return;
  }
  const std::size_t before = dataset.pairs.size() + dataset.problems.size();
  const fs::path folder = file.parent_path();
  std::string line;
  int bad_lines = 0;
  for (int number = 1; std::getline(in, line); ++number) {
    std::istringstream words(line.substr(0, line.find_first_of(std::string("#\0", 2))));
    std::vector<std::string> fields;
    for (std::string word; words >> word;) fields.push_back(word);
    const bool is_text = line.find('\0') == std::string::npos;
    if (is_text && fields.empty()) continue;
    if (!is_text || fields.size() != 4) {
      const std::string other = otherThanAList(file.string(), line);
      if (!other.empty()) {
        dataset.problems.push_back(file.string() + ": " + other + "; expected a list with " + kRow +
                                   " a line");
        return;
      }
      dataset.problems.push_back(file.string() + ":" + std::to_string(number) + ": expected " +
                                 kRow);
      if (++bad_lines < kMostBadLines) continue;
      dataset.problems.push_back(file.string() + ": " + std::to_string(bad_lines) +
                                 " lines cannot be read; the rest of it was not read");
      return;
    }
    addPair({file.stem().string(),
             fields[0],
             (folder / fields[1]).string(),
             (folder / fields[2]).string(),
             {},
             {},
             {}},
            (folder / fields[3]).string(), dataset);
  }
  if (dataset.pairs.size() + dataset.problems.size() == before) {
    dataset.problems.push_back(file.string() +
                               ": names no pair; expected `name imageA imageB homography` a line");
  }
}

/// The picture at `path`, or all pictures of the folder `path` in the order of their names.
std::vector<std::string> pictures(const std::string& path, Dataset& dataset) {
  if (!isThere(path)) {
    dataset.problems.push_back(path + ": is missing");
    return {};
  }
  if (!isFolder(path)) return {path};
  std::vector<std::string> found;
  for (const auto& entry : fs::directory_iterator(path)) {
    const std::string ending = entry.path().extension().string();
    const bool is_image =
        std::find(kImageEndings.begin(), kImageEndings.end(), ending) != kImageEndings.end();
    if (is_image) found.push_back(entry.path().string());
  }
  if (found.empty()) dataset.problems.push_back(path + ": holds no image");
  std::sort(found.begin(), found.end());
  return found;
}

}  // namespace

void addPairs(const std::string& path, Dataset& dataset) {
  if (!isFolder(path)) {
    addList(path, dataset);
  } else if (!addFolder(path, dataset)) {
    addSubfolders(path, dataset);
  }
}

void addWarps(const std::string& name, const std::vector<std::string>& paths, int count,
              std::uint64_t seed, Dataset& dataset) {
  const std::optional<WarpLimits> limits = warpLimits(name);
  if (!limits) {
    throw std::invalid_argument("there are no warps " + name +
                                "; use tiny, small, medium, large or extreme");
  }
  std::vector<std::string> files;
  for (const std::string& path : paths) {
    for (std::string& file : pictures(path, dataset)) files.push_back(std::move(file));
  }
  if (files.empty()) return;
  dataset.files.insert(dataset.files.end(), files.begin(), files.end());
  const auto n = static_cast<int>(files.size());
  for (int i = 0; i < count; ++i) {
    // Every second warp is degraded. If the number of pictures is even, each round starts one
    // picture further, so that each picture is used clean and degraded.
    const int picture = (i + (n % 2 == 0 ? i / n : 0)) % n;
    const std::string& file = files[static_cast<std::size_t>(picture)];
    const Warp warp = drawWarp(*limits, i, seed);
    dataset.pairs.push_back({name, std::to_string(i), file, file, warp.homography, {}, warp});
  }
}

}  // namespace ktgp_orb::evaluation
