#include "nodelet/target_book.h"

#include <algorithm>
#include <boost/make_shared.hpp>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <stdexcept>

#include "messages/image_conversion.h"

namespace ktgp_orb {
namespace {

namespace fs = std::filesystem;

/// The folder for the images of a kept list.
fs::path folderOf(const std::string& list) {
  return fs::absolute(list + "_images");
}

cv::Mat readGrey(const std::string& file) {
  return greyImage(readImageFile("target", file)).clone();
}

Target targetOf(const SetTarget::Request& request) {
  Target target{request.id, {}, request.width, request.frame};
  for (const sensor_msgs::Image& image : request.images) {
    requireSmall("an image of the target", image);
    target.images.push_back(greyImage(boost::make_shared<sensor_msgs::Image>(image)).clone());
  }
  return target;
}

/// The kept list before it replaces the old one.
std::string nextOf(const std::string& list) {
  return list + ".unfinished";
}

/// Takes the entries with this id out of the list and appends them to `taken`.
template <typename Entries>
void moveOut(const std::string& id, Entries& entries, std::vector<TargetEntry>& taken) {
  const auto others = std::stable_partition(entries.begin(), entries.end(),
                                            [&](const TargetEntry& one) { return one.id != id; });
  taken.insert(taken.end(), others, entries.end());
  entries.erase(others, entries.end());
}

template <typename Entries>
bool areThere(const Entries& entries, const std::string& id) {
  return std::any_of(entries.begin(), entries.end(),
                     [&](const TargetEntry& one) { return one.id == id; });
}

}  // namespace

void TargetBook::open(const std::string& targets, const std::string& file) {
  file_ = file;
  const bool was_kept = !file.empty() && fs::exists(file);
  if (!file.empty() && !was_kept) {
    std::error_code error;
    fs::create_directories(folderOf(file), error);
    if (error) throw std::invalid_argument(file + ": cannot be written: " + error.message());
  }
  if (fs::is_directory(file)) {
    throw std::invalid_argument(file + ": is a folder; expected the name of a YAML list");
  }
  std::error_code none;
  // Empty: the power failed while it was written. Then the list that was given counts.
  const std::string& list = was_kept && fs::file_size(file, none) > 0 ? file : targets;
  if (list.empty()) return;
  const std::vector<TargetEntry> entries = readTargetList(list);
  lists_.waiting.assign(entries.begin(), entries.end());
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
    user_.add(readTarget(entry, readGrey));
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
    throw std::invalid_argument("target \"" + request.id +
                                "\" exists already, and is still to be read; expected a new id");
  }
  set(request, user_.add);
}

/// A target that is still to be read, or was refused, is replaced, too.
void TargetBook::replace(const SetTarget::Request& request) {
  const bool is_unused =
      !areThere(lists_.used, request.id) &&
      (areThere(lists_.waiting, request.id) || areThere(lists_.refused, request.id));
  set(request, is_unused ? user_.add : user_.replace);
}

/// Writes the files first: if the disk is full, nothing has changed.
void TargetBook::set(const SetTarget::Request& request, const UseTarget& use) {
  const Target target = targetOf(request);
  TargetEntry entry{target.id, {}, target.width, target.frame};
  Lists next = lists_;
  const std::vector<TargetEntry> replaced = next.takeOut(target.id);
  try {
    writeImages(target, entry.files);
    next.used.push_back(entry);
    writeNext(next);
    use(target);
  } catch (...) {
    discardNext();
    deleteImages({entry});
    throw;
  }
  adoptNext(std::move(next));
  deleteImages(replaced);
}

void TargetBook::remove(const std::string& id) {
  Lists next = lists_;
  const std::vector<TargetEntry> removed = next.takeOut(id);
  if (removed.empty()) throw std::invalid_argument("target \"" + id + "\" does not exist");
  writeNext(next);
  user_.remove(id);
  adoptNext(std::move(next));
  deleteImages(removed);
}

/// They get new names, so that those of the old list stay complete until it is replaced. Appends
/// the name of each one before it is written.
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
    std::vector<std::uint8_t> bytes;
    cv::imencode(".png", image, bytes);
    files.push_back(name.string());
    writeFile(name.string(), std::string(bytes.begin(), bytes.end()));
  }
}

/// Writes the new list beside the old one.
void TargetBook::writeNext(const Lists& lists) const {
  if (file_.empty()) return;
  std::vector<TargetEntry> entries = lists.used;
  entries.insert(entries.end(), lists.refused.begin(), lists.refused.end());
  entries.insert(entries.end(), lists.waiting.begin(), lists.waiting.end());
  for (TargetEntry& entry : entries) {
    for (std::string& file : entry.files) file = fs::absolute(file).string();
  }
  writeTargetList(nextOf(file_), entries);
}

/// The list that was written last replaces the old one.
void TargetBook::adoptNext(Lists lists) {
  lists_ = std::move(lists);
  if (!file_.empty()) fs::rename(nextOf(file_), file_);
}

void TargetBook::discardNext() const {
  std::error_code none;
  if (!file_.empty()) fs::remove(nextOf(file_), none);
}

/// Only those in the folder of the list: the others are the user's.
void TargetBook::deleteImages(const std::vector<TargetEntry>& of) const {
  if (file_.empty()) return;
  std::error_code none;
  for (const TargetEntry& entry : of) {
    for (const std::string& file : entry.files) {
      if (fs::path(file).parent_path() == folderOf(file_)) fs::remove(file, none);
    }
  }
}

}  // namespace ktgp_orb
