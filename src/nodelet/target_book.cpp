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

/// Of the images that belong to a kept list.
fs::path folderOf(const std::string& list) {
  return fs::absolute(list + "_images");
}

cv::Mat readGrey(const std::string& file) {
  return greyImage(readImageFile("target", file)).clone();
}

Target targetOf(const SetTarget::Request& request) {
  Target target{request.id, {}, request.width, request.frame};
  for (const sensor_msgs::Image& image : request.images) {
    target.images.push_back(greyImage(boost::make_shared<sensor_msgs::Image>(image)).clone());
  }
  return target;
}

}  // namespace

void TargetBook::open(const std::string& targets, const std::string& file) {
  file_ = file;
  const bool was_kept = !file.empty() && fs::exists(file);
  const std::string& list = was_kept ? file : targets;
  if (list.empty()) return;
  const std::vector<TargetEntry> entries = readTargetList(list);
  waiting_.assign(entries.begin(), entries.end());
}

std::string TargetBook::loadNext() {
  const TargetEntry entry = waiting_.front();
  waiting_.pop_front();
  const std::vector<std::string> refused = addTargets({entry}, readGrey, finder_);
  (refused.empty() ? entries_ : refused_).push_back(entry);
  return refused.empty() ? "" : refused.front();
}

std::string TargetBook::whereKept() const {
  return file_.empty() ? "" : "; it stays in " + file_;
}

bool TargetBook::hasFrames() const {
  return std::any_of(entries_.begin(), entries_.end(),
                     [](const TargetEntry& entry) { return !entry.frame.empty(); });
}

void TargetBook::add(const SetTarget::Request& request) {
  set(request, false);
}

void TargetBook::replace(const SetTarget::Request& request) {
  set(request, true);
}

void TargetBook::set(const SetTarget::Request& request, bool replace) {
  const Target target = targetOf(request);
  if (replace) {
    finder_.replace(target);
  } else {
    finder_.add(target);
  }
  keep(target);
}

void TargetBook::remove(const std::string& id) {
  const bool was_used = finder_.remove(id);
  const std::vector<TargetEntry> removed = takeOut(id);
  if (!was_used && removed.empty()) {
    throw std::invalid_argument("target \"" + id + "\" does not exist");
  }
  write();
  deleteImages(removed);
}

void TargetBook::keep(const Target& target) {
  const TargetEntry entry{target.id, writeImages(target), target.width, target.frame};
  const std::vector<TargetEntry> replaced = takeOut(target.id);
  entries_.push_back(entry);
  write();
  deleteImages(replaced);
}

/// They get new names, so that those of an older list stay complete until it is replaced.
std::vector<std::string> TargetBook::writeImages(const Target& target) const {
  std::vector<std::string> files;
  if (file_.empty()) return files;
  const fs::path folder = folderOf(file_);
  std::error_code none;
  fs::create_directories(folder, none);
  int number = 0;
  for (const cv::Mat& image : target.images) {
    fs::path name;
    do {
      name = folder / (std::to_string(number++) + ".png");
    } while (fs::exists(name, none));
    if (!cv::imwrite(name.string(), image)) {
      throw std::invalid_argument("target \"" + target.id + "\" is in use, but not kept: " +
                                  name.string() + " cannot be written");
    }
    files.push_back(name.string());
  }
  return files;
}

/// The entries with this id, in use or refused, which are no longer there.
std::vector<TargetEntry> TargetBook::takeOut(const std::string& id) {
  std::vector<TargetEntry> taken;
  for (std::vector<TargetEntry>* entries : {&entries_, &refused_}) {
    const auto others = std::stable_partition(entries->begin(), entries->end(),
                                              [&](const TargetEntry& one) { return one.id != id; });
    taken.insert(taken.end(), others, entries->end());
    entries->erase(others, entries->end());
  }
  return taken;
}

void TargetBook::write() const {
  if (file_.empty()) return;
  std::vector<TargetEntry> entries = entries_;
  entries.insert(entries.end(), refused_.begin(), refused_.end());
  entries.insert(entries.end(), waiting_.begin(), waiting_.end());
  for (TargetEntry& entry : entries) {
    for (std::string& file : entry.files) file = fs::absolute(file).string();
  }
  writeTargetList(file_, entries);
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
