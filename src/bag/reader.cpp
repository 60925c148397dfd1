#include "bag/reader.h"

#include <sensor_msgs/CompressedImage.h>

#include <algorithm>
#include <set>
#include <utility>

#include "bag/messages.h"
#include "core/util/format.h"
#include "messages/image_conversion.h"

namespace ktgp_orb {
namespace {

constexpr char kCompressed[] = "/compressed";

/// Without what image transport appends.
std::string rawTopic(const std::string& topic) {
  const std::size_t suffix = sizeof kCompressed - 1;
  const std::size_t end = topic.size() - std::min(topic.size(), suffix);
  return topic.compare(end, std::string::npos, kCompressed) == 0 ? topic.substr(0, end) : topic;
}

bool isImage(const bag::Topic& topic) {
  return topic.type == "sensor_msgs/Image" || topic.type == "sensor_msgs/CompressedImage";
}

RecordedImage decoded(const sensor_msgs::CompressedImage& message, const ros::Time& received) {
  if (const auto image = decodedImage(message)) return {image, received};
  return {nullptr, received, "compressed image cannot be decoded"};
}

class BagImages : public ImageSource {
 public:
  BagImages(const std::string& path, const BagSelection& selection) : messages_(path) {
    chooseTopic(path, selection.topic);
    messages_.select(
        [this](const bag::Topic& topic) { return isImage(topic) && topic.name == topic_; },
        selection.start, selection.duration);
    if (messages_.total() == 0) {
      throw UnusableBag(path + " has no image on '" + topic_ + "' in the selected time" +
                        whatIsDamaged());
    }
  }

  std::optional<RecordedImage> next() override {
    while (const auto message = messages_.next()) {
      if (const auto image = message->as<sensor_msgs::Image>()) {
        return RecordedImage{image, message->received};
      }
      if (const auto compressed = message->as<sensor_msgs::CompressedImage>()) {
        return decoded(*compressed, message->received);
      }
      messages_.reject("an image message at " + std::to_string(message->received.toSec()) +
                       " s is not an image message");
    }
    return std::nullopt;
  }

  std::size_t total() const override { return messages_.total(); }
  const std::string& topic() const override { return topic_; }
  std::string damage() const override { return messages_.damage("images"); }

 private:
  void chooseTopic(const std::string& path, const std::string& wanted) {
    std::set<std::string> names;
    for (const bag::Topic& topic : messages_.topics()) {
      if (isImage(topic)) names.insert(topic.name);
    }
    topic_ = wanted;
    if (topic_.empty() && names.size() == 1) topic_ = *names.begin();
    if (names.count(topic_) > 0) return;
    topic_ = rawTopic(wanted) == wanted ? wanted + kCompressed : rawTopic(wanted);
    if (names.count(topic_) > 0) return;
    const std::string has =
        wanted.empty() ? " has no single image topic" : " has no image on '" + wanted + "'";
    throw UnusableBag(path + has + "; its image topics: " +
                      (names.empty() ? "none" : util::joined(names, ", ")) + whatIsDamaged());
  }

  std::string whatIsDamaged() const {
    const std::string damage = messages_.damage("images");
    return damage.empty() ? "" : "; the bag is damaged: " + damage;
  }

  BagMessages messages_;
  std::string topic_;
};

}  // namespace

std::string cameraOf(const std::string& image_topic) {
  const std::string raw = rawTopic(image_topic);
  return raw.substr(0, raw.rfind('/'));
}

sensor_msgs::CameraInfo readCameraInfo(const std::string& path, const std::string& image_topic,
                                       const std::string& user) {
  const std::string name = cameraOf(image_topic) + "/camera_info";
  BagMessages messages(path);
  messages.select([&name](const bag::Topic& topic) { return topic.name == name; });
  while (const auto message = messages.next()) {
    if (const auto info = message->as<sensor_msgs::CameraInfo>()) return *info;
  }
  throw UnusableBag(path + ": it has no camera_info on '" + name + "', which " + user + " needs");
}

std::unique_ptr<ImageSource> openBag(const std::string& path, const BagSelection& selection) {
  return std::make_unique<BagImages>(path, selection);
}

}  // namespace ktgp_orb
