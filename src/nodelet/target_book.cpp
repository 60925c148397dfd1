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
  if (!refused.empty()) return refused.front();
  entries_.push_back(entry);
  return "";
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
  if (!finder_.remove(id)) throw std::invalid_argument("target \"" + id + "\" does not exist");
  const auto is_this = [&](const TargetEntry& entry) { return entry.id == id; };
  entries_.erase(std::remove_if(entries_.begin(), entries_.end(), is_this), entries_.end());
  write();
}

/// The images get new names, so that those of an older list stay complete until it is replaced.
void TargetBook::keep(const Target& target) {
  TargetEntry entry{target.id, {}, target.width, target.frame};
  if (!file_.empty()) {
    const fs::path folder = fs::path(file_ + "_images");
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
      entry.files.push_back(fs::absolute(name).string());
    }
  }
  const auto is_this = [&](const TargetEntry& other) { return other.id == entry.id; };
  const auto place = std::find_if(entries_.begin(), entries_.end(), is_this);
  if (place == entries_.end()) {
    entries_.push_back(entry);
  } else {
    *place = entry;
  }
  write();
}

void TargetBook::write() const {
  if (file_.empty()) return;
  std::vector<TargetEntry> entries = entries_;
  entries.insert(entries.end(), waiting_.begin(), waiting_.end());
  for (TargetEntry& entry : entries) {
    for (std::string& file : entry.files) file = fs::absolute(file).string();
  }
  writeTargetList(file_, entries);
}

}  // namespace ktgp_orb
