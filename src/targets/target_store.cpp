#include "targets/target_store.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "targets/conflicts.h"
#include "util/format.h"
#include "util/printable.h"

namespace ktgp_orb::targets {
namespace {

// Minimum number of keypoints of an image; the keypoints of its tilted views are not counted. To
// find a target by keypoints, a search needs eight pairs (kTargetPlan.fewest_pairs).
constexpr std::size_t kFewestKeypoints = 40;

[[noreturn]] void refuse(const std::string& id, const std::string& reason) {
  throw std::invalid_argument("target " + util::quoted(id) + ": " + reason);
}

void requireShort(const std::string& id, const char* name, const std::string& text) {
  constexpr std::size_t kLongest = 256;
  if (text.size() <= kLongest) return;
  refuse(id, std::string("the ") + name + " has " + std::to_string(text.size()) +
                 " bytes; expected at most " + std::to_string(kLongest));
}

void requireNames(const Target& target) {
  if (target.id.empty()) throw std::invalid_argument("a target has no id; expected a name");
  requireShort(target.id, "id", target.id);
  requireShort(target.id, "frame", target.frame);
  const bool is_blank =
      util::withoutSlash(target.frame).find_first_not_of(" \t\r\n") == std::string::npos;
  if (is_blank && !target.frame.empty()) {
    refuse(target.id, "the frame is " + util::quoted(target.frame) + "; expected a name");
  }
}

/// Explains to the user why a picture has fewer than kFewestKeypoints: it has too little texture,
/// or it is too narrow.
std::string whyFewKeypoints(const TargetPicture& picture) {
  constexpr int kNarrow = 40;  // px; a picture is narrow if its shorter side is smaller than this
  const std::string count = std::to_string(picture.own) + " keypoints; expected " +
                            std::to_string(kFewestKeypoints) + " or more, from ";
  const cv::Size size = picture.image.size();
  if (std::min(size.width, size.height) >= kNarrow) {
    return " has too little texture: " + count + "a sharp image of a picture with details";
  }
  const bool is_smaller = size != picture.full_size;
  const int least = static_cast<int>(std::ceil(kNarrow / picture.scale));
  return " is too narrow: " + util::text(picture.full_size) + " px " +
         (is_smaller ? "(made smaller: " + util::text(size) + ") " : "") + "with " + count +
         "a shorter side of " + std::to_string(least) + " px or more";
}

}  // namespace

std::vector<TargetPicture> TargetStore::prepare(const Target& target, int views) const {
  requireNames(target);
  if (!std::isfinite(target.width) || target.width < 0.0) {
    refuse(target.id, "the width is " + std::to_string(target.width) +
                          " m; expected a positive one, or 0 if it is not known");
  }
  if (target.images.empty()) refuse(target.id, "it has no image");
  std::vector<TargetPicture> pictures;
  for (std::size_t i = 0; i < target.images.size(); ++i) {
    const std::string name = "image " + std::to_string(i + 1);
    const cv::Mat& image = target.images[i];
    if (image.empty()) refuse(target.id, name + " is empty");
    if (image.type() != CV_8UC1) refuse(target.id, name + " is not 8-bit grey");
    pictures.push_back(
        makePicture(image, options_.orb, options_.features, options_.largest_side, views));
    if (pictures.back().own < kFewestKeypoints) {
      refuse(target.id, name + whyFewKeypoints(pictures.back()));
    }
  }
  return pictures;
}

StoredTarget& TargetStore::add(const Target& target, std::vector<TargetPicture> pictures) {
  auto stored = std::make_unique<StoredTarget>();
  stored->id = target.id;
  stored->width = target.width;
  stored->frame = util::withoutSlash(target.frame);
  for (const TargetPicture& picture : pictures) {
    if (stored->ambiguity.empty()) stored->ambiguity = ambiguityOf(picture);
  }
  std::uint32_t number = freeNumbers(pictures.size());
  pictures_.resize(std::max(pictures_.size(), number + pictures.size()));
  for (TargetPicture& picture : pictures) {
    picture.owner = stored.get();
    pictures_[number] = std::make_unique<TargetPicture>(std::move(picture));
    index_.add(number, pictures_[number]->frames.bits());
    stored->pictures.push_back(number++);
    ++count_;
  }
  targets_.push_back(std::move(stored));
  return *targets_.back();
}

std::uint32_t TargetStore::freeNumbers(std::size_t count) const {
  std::uint32_t number = 0;
  for (std::size_t run = 0; run < count; ++number) run = index_.isFree(number) ? run + 1 : 0;
  return number - static_cast<std::uint32_t>(count);
}

void TargetStore::remove(const StoredTarget& target) {
  for (const std::uint32_t number : target.pictures) {
    index_.remove(number);
    pictures_[number].reset();
    --count_;
  }
  const auto is_this = [&](const auto& stored) { return stored.get() == &target; };
  targets_.erase(std::find_if(targets_.begin(), targets_.end(), is_this));
}

StoredTarget* TargetStore::find(const std::string& id) {
  for (const auto& target : targets_) {
    if (target->id == id) return target.get();
  }
  return nullptr;
}

}  // namespace ktgp_orb::targets
