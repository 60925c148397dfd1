#include "nodelet/target_book.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <cerrno>
#include <filesystem>
#include <regex>
#include <set>
#include <stdexcept>

#include "ros/image_conversion.h"
#include "util/printable.h"

namespace ktgp_orb {
namespace {

namespace fs = std::filesystem;

/// Returns the canonical path of `list`, the file in which a node keeps its list of targets. Two
/// nodes may use different paths, such as links, for the same file. Throws std::invalid_argument
/// with the reason if no list can be kept at this path.
std::string realNameOf(const std::string& list) {
  std::error_code none;
  const fs::file_status status = fs::status(list, none);
  if (fs::is_directory(status)) {
    throw std::invalid_argument(list + ": is a folder; expected the name of a YAML list");
  }
  if (fs::exists(status) && !fs::is_regular_file(status)) {
    throw std::invalid_argument(list + ": is no regular file; expected the name of a YAML list");
  }
  if (!fs::exists(status) && fs::is_symlink(fs::symlink_status(list, none))) {
    throw std::invalid_argument(list + ": is a link to a file that is missing; expected the name " +
                                "of that file");
  }
  const fs::path real = fs::weakly_canonical(fs::absolute(list), none);
  return none ? fs::absolute(list).string() : real.string();
}

/// Returns the folder for the images of the list that is kept in the file `list`.
fs::path folderOf(const std::string& list) {
  return list + "_images";
}

Target targetOf(const SetTarget::Request& request) {
  Target target{request.id, {}, request.width, request.frame};
  requireSmall("the images of the target", request.images);
  for (const sensor_msgs::Image& image : request.images) {
    target.images.push_back(greyImage(boost::make_shared<sensor_msgs::Image>(image)).clone());
  }
  return target;
}

/// Moves the entries with this id from `entries` to the end of `taken`.
template <typename Entries>
void moveOut(const std::string& id, Entries& entries, std::vector<TargetEntry>& taken) {
  const auto others = std::stable_partition(entries.begin(), entries.end(),
                                            [&](const TargetEntry& one) { return one.id != id; });
  taken.insert(taken.end(), others, entries.end());
  entries.erase(others, entries.end());
}

/// Adds the names of the entries' files to `names`, without their folders.
template <typename Entries>
void addNames(const Entries& entries, std::set<std::string>& names) {
  for (const TargetEntry& entry : entries) {
    for (const std::string& file : entry.files) names.insert(fs::path(file).filename().string());
  }
}

template <typename Entries>
bool areThere(const Entries& entries, const std::string& id) {
  return std::any_of(entries.begin(), entries.end(),
                     [&](const TargetEntry& one) { return one.id == id; });
}

}  // namespace

TargetBook::~TargetBook() {
  if (lock_ >= 0) close(lock_);
}

void TargetBook::open(const std::string& targets, const std::string& file) {
  file_ = file.empty() ? "" : realNameOf(file);
  if (!file_.empty()) lock();
  std::error_code none;
  const std::uintmax_t size = fs::file_size(file_, none);
  const bool was_kept = !none && size > 0;
  const std::string& list = was_kept ? file_ : targets;
  if (list.empty()) return;
  std::vector<TargetEntry> entries = readTargetList(list);
  if (was_kept) {
    // Drop the line numbers of the entries in the list. They change whenever a target is added or
    // removed.
    for (TargetEntry& entry : entries) entry.place.clear();
    deleteAllBut(entries);
  }
  lists_.waiting.assign(entries.begin(), entries.end());
}

/// Locks the folder of the images. A lock on the file of the list would end as soon as a new file
/// replaces it.
void TargetBook::lock() {
  const std::string folder = folderOf(file_).string();
  std::error_code error;
  fs::create_directories(folder, error);
  if (error) throw std::invalid_argument(file_ + ": cannot be written: " + error.message());
  lock_ = ::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (lock_ < 0 || (flock(lock_, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK)) {
    throw std::invalid_argument(file_ + ": is in use by another node; expected a file of its own");
  }
}

std::vector<TargetEntry> TargetBook::Lists::takeOut(const std::string& id) {
  std::vector<TargetEntry> taken;
  moveOut(id, used, taken);
  moveOut(id, refused, taken);
  moveOut(id, waiting, taken);
  return taken;
}

void TargetBook::loadNext() {
  const TargetEntry entry = lists_.waiting.front();
  lists_.waiting.pop_front();
  try {
    addTarget(entry, [this](const Target& target) {
      use_finder_([&](TargetFinder& finder) { finder.add(target); });
    });
    lists_.used.push_back(entry);
  } catch (const std::exception& error) {
    lists_.refused.push_back(entry);
    reasons_[entry.id] = error.what();
  }
}

std::string TargetBook::refusal() const {
  if (lists_.refused.empty()) return "";
  const std::size_t count = lists_.refused.size();
  const std::string& last = lists_.refused.back().id;
  return (count == 1 ? "a target is refused: "
                     : std::to_string(count) + " targets are refused, the last one: ") +
         reasons_.at(last) + (file_.empty() ? "" : "; it stays in " + file_);
}

bool TargetBook::hasFrames() const {
  return std::any_of(lists_.used.begin(), lists_.used.end(),
                     [](const TargetEntry& entry) { return !entry.frame.empty(); });
}

void TargetBook::add(const SetTarget::Request& request) {
  if (areThere(lists_.waiting, request.id)) {
    throw std::invalid_argument("target " + util::quoted(request.id) +
                                " exists already, and is still to be read; expected a new id");
  }
  set(request, &TargetFinder::add);
}

/// Also replaces a target that was refused, or that waits to be read.
void TargetBook::replace(const SetTarget::Request& request) {
  const bool is_unused =
      !areThere(lists_.used, request.id) &&
      (areThere(lists_.waiting, request.id) || areThere(lists_.refused, request.id));
  set(request, is_unused ? &TargetFinder::add : &TargetFinder::replace);
}

/// Writes the images and the new list first, so that a full disk does not change the targets.
void TargetBook::set(const SetTarget::Request& request, void (TargetFinder::*use)(const Target&)) {
  const Target target = targetOf(request);
  TargetEntry entry{target.id, {}, target.width, target.frame, ""};
  Lists next = lists_;
  const std::vector<TargetEntry> replaced = next.takeOut(target.id);
  try {
    writeImages(target, entry.files);
    next.used.push_back(entry);
    const std::unique_ptr<files::OutputFile> list = writtenBeside(next);
    use_finder_([&](TargetFinder& finder) { (finder.*use)(target); });
    if (list) list->commit();
  } catch (...) {
    deleteImages({entry});
    throw;
  }
  lists_ = std::move(next);
  deleteImages(replaced);
}

void TargetBook::remove(const std::string& id) {
  Lists next = lists_;
  const std::vector<TargetEntry> removed = next.takeOut(id);
  if (removed.empty())
    throw std::invalid_argument("target " + util::quoted(id) + " does not exist");
  const std::unique_ptr<files::OutputFile> list = writtenBeside(next);
  use_finder_([&](TargetFinder& finder) { finder.remove(id); });
  if (list) list->commit();
  lists_ = std::move(next);
  deleteImages(removed);
}

/// Writes the images under new names, so that the images of the old list stay complete until that
/// list is replaced. Appends each name to `files` before it writes the file.
void TargetBook::writeImages(const Target& target, std::vector<std::string>& files) const {
  if (file_.empty()) return;
  const fs::path folder = folderOf(file_);
  std::error_code none;
  fs::create_directories(folder, none);
  int number = 0;
  for (const cv::Mat& image : target.images) {
    fs::path name;
    do {
      name = folder / (std::to_string(number++) + ".png");
    } while (fs::exists(name, none));
    files.push_back(name.string());
    files::writeImage(name.string(), image, false);
  }
}

std::unique_ptr<files::OutputFile> TargetBook::writtenBeside(const Lists& lists) const {
  if (file_.empty()) return nullptr;
  std::vector<TargetEntry> entries = lists.used;
  entries.insert(entries.end(), lists.refused.begin(), lists.refused.end());
  entries.insert(entries.end(), lists.waiting.begin(), lists.waiting.end());
  auto list = std::make_unique<files::OutputFile>(file_, true);
  files::write(*list, textOfTargetList(entries));
  return list;
}

/// Deletes images in the folder that no entry uses. They are left over if a node was killed after
/// it had written them, or before it could delete them. Deletes only files with names that
/// writeImages() gives, such as 12.png and 12.unfinished0.png.
void TargetBook::deleteAllBut(const std::vector<TargetEntry>& entries) const {
  std::set<std::string> named;
  addNames(entries, named);
  static const std::regex ours("[0-9]+(\\.unfinished[0-9]+)?\\.png");
  std::error_code none;
  for (const fs::path& file : fs::directory_iterator(folderOf(file_), none)) {
    const std::string name = file.filename().string();
    if (named.count(name) == 0 && std::regex_match(name, ours)) fs::remove(file, none);
  }
}

/// Deletes only images in the folder of the list, since all other images belong to the user, and
/// only those that no entry of the list names: several entries may name the same image.
void TargetBook::deleteImages(const std::vector<TargetEntry>& of) const {
  if (file_.empty()) return;
  std::set<std::string> named;
  addNames(lists_.used, named);
  addNames(lists_.refused, named);
  addNames(lists_.waiting, named);
  std::error_code none;
  for (const TargetEntry& entry : of) {
    for (const std::string& file : entry.files) {
      const fs::path path(file);
      if (path.parent_path() == folderOf(file_) && named.count(path.filename().string()) == 0) {
        fs::remove(path, none);
      }
    }
  }
}

}  // namespace ktgp_orb
