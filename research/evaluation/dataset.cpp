#include "evaluation/dataset.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>
#include <stdexcept>
#include <system_error>

#include "evaluation/truth_points.h"
#include "files/input.h"

namespace ktgp_orb::evaluation {
namespace {

namespace fs = std::filesystem;

constexpr int kImagesPerSet = 6;  // at least
constexpr std::array<const char*, 8> kImageEndings{".ppm",  ".pgm", ".png",  ".jpg",
                                                   ".jpeg", ".tif", ".tiff", ".bmp"};

// Both functions also return false for an invalid name, for example a name that is too long.
bool isThere(const fs::path& path) {
  std::error_code none;
  return fs::exists(path, none);
}
bool isFolder(const fs::path& path) {
  std::error_code none;
  return fs::is_directory(path, none);
}

std::string inCase(int (*change)(int), std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [&](unsigned char c) { return static_cast<char>(change(c)); });
  return text;
}

/// The image `stem` with any of the usual endings, or with `.ending` if there is none.
std::string imageOf(const fs::path& stem, const char* ending) {
  for (const char* known : kImageEndings) {
    for (const std::string& each : {std::string(known), inCase(std::toupper, known)}) {
      if (isThere(stem.string() + each)) return stem.string() + each;
    }
  }
  return stem.string() + ending;
}

/// The images in the folder in the order of their names.
std::vector<fs::path> imagesIn(const fs::path& folder) {
  std::vector<fs::path> images;
  if (!isFolder(folder)) return images;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const std::string ending = inCase(std::tolower, entry.path().extension().string());
    if (std::count(kImageEndings.begin(), kImageEndings.end(), ending) > 0) {
      images.push_back(entry.path());
    }
  }
  std::sort(images.begin(), images.end());
  return images;
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

std::string imageFile(const fs::path& folder, const Layout& layout, int k) {
  return imageOf(folder / (layout.image_prefix + std::to_string(k)), ".ppm");
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
  const std::string set = nameOfSet(folder.string(), dataset.sets);
  int images = kImagesPerSet;
  while (isThere(imageFile(folder, layout, images + 1)) ||
         isThere(folder / layout.homography(1, images + 1))) {
    ++images;
  }
  for (int i = 1; i < images; ++i) {
    const std::string reference = imageFile(folder, layout, i);
    for (int k = i + 1; k <= images; ++k) {
      const fs::path homography = folder / layout.homography(i, k);
      if (i > 1 && !isThere(homography)) continue;  // most sets have only homographies of image 1
      const std::string target = imageFile(folder, layout, k);
      addPair({set, std::to_string(i) + "-" + std::to_string(k), reference, target, {}, {}, {}},
              homography.string(), dataset);
    }
  }
}

/// The names of the truths in the folder: its files with this ending, without it.
std::set<std::string> truthsIn(const fs::path& folder, const char* ending) {
  std::set<std::string> names;
  if (!isFolder(folder)) return names;
  for (const auto& entry : fs::directory_iterator(folder)) {
    if (entry.path().extension() == ending) names.insert(entry.path().stem().string());
  }
  return names;
}

bool addExtremeViews(const fs::path& folder, Dataset& dataset) {
  std::set<std::string> names = truthsIn(folder / "h", ".txt");
  if (names.empty() || !isFolder(folder / "1") || !isFolder(folder / "2")) return false;
  // An image without its truth is a problem, too.
  for (const fs::path& image : imagesIn(folder / "1")) names.insert(image.stem().string());
  const std::string set = nameOfSet(folder.string(), dataset.sets);
  for (const std::string& name : names) {
    addPair({set,
             name,
             imageOf(folder / "1" / name, ".png"),
             imageOf(folder / "2" / name, ".png"),
             {},
             {},
             {}},
            (folder / "h" / (name + ".txt")).string(), dataset);
  }
  return true;
}

bool addAnnotated(const fs::path& folder, Dataset& dataset) {
  std::set<std::string> names = truthsIn(folder, kPointsEnding);
  if (names.empty()) return false;
  for (const fs::path& image : imagesIn(folder)) {
    const std::string stem = image.stem().string();
    if (stem.back() == 'A') names.insert(stem.substr(0, stem.size() - 1));
  }
  const std::string set = nameOfSet(folder.string(), dataset.sets);
  for (const std::string& name : names) {
    addPair({set,
             name,
             imageOf(folder / (name + "A"), ".png"),
             imageOf(folder / (name + "B"), ".png"),
             {},
             {},
             {}},
            (folder / (name + kPointsEnding)).string(), dataset);
  }
  return true;
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
  std::vector<fs::path> subfolders, unknown;
  for (const auto& entry : fs::directory_iterator(folder)) {
    const bool is_hidden = entry.path().filename().string().front() == '.';
    if (entry.is_directory() && !is_hidden) subfolders.push_back(entry.path());
  }
  std::sort(subfolders.begin(), subfolders.end());
  for (const fs::path& subfolder : subfolders) {
    if (!addFolder(subfolder, dataset)) unknown.push_back(subfolder);
  }
  if (unknown.size() == subfolders.size()) unknown = {folder};
  for (const fs::path& each : unknown) {
    dataset.problems.push_back(
        each.string() +
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
  const std::string set = nameOfSet(file.string(), dataset.sets);
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
    addPair(
        {set, fields[0], (folder / fields[1]).string(), (folder / fields[2]).string(), {}, {}, {}},
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
  for (const fs::path& image : imagesIn(path)) found.push_back(image.string());
  if (found.empty()) dataset.problems.push_back(path + ": holds no image");
  return found;
}

}  // namespace

std::string nameOfSet(const std::string& path, std::map<std::string, std::string>& sets) {
  std::error_code error;
  fs::path full = fs::canonical(path, error);
  if (error) full = fs::absolute(path);  // for example a pipe
  const auto is_full = [&](const auto& set) { return set.second == full.string(); };
  if (std::any_of(sets.begin(), sets.end(), is_full)) {
    throw std::invalid_argument(path + " is given twice");
  }
  std::string name = (fs::is_directory(full) ? full.filename() : full.stem()).string();
  for (fs::path parent = full.parent_path(); sets.count(name) > 0; parent = parent.parent_path()) {
    name = (parent.filename() / name).string();
  }
  sets[name] = full.string();
  return name;
}

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
