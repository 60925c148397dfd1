#include "bag/reader.h"

#include <sensor_msgs/CompressedImage.h>

#include <algorithm>
#include <iterator>

#include "ros/camera.h"
#include "ros/image_conversion.h"
#include "ros/image_stamps.h"
#include "ros/stamps.h"
#include "util/format.h"

namespace ktgp_orb {
namespace {

bool isImage(const bag::Topic& topic) {
  return bag::isOf<sensor_msgs::Image>(topic) || bag::isOf<sensor_msgs::CompressedImage>(topic);
}

/// Returns true if the topic has images of a type that we cannot read: from another transport, or
/// with an old message definition.
bool isOtherImage(const bag::Topic& topic) {
  const bool is_named = topic.type.find("Image") != std::string::npos ||
                        topic.type.find("Packet") != std::string::npos;
  return is_named && !isImage(topic);
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
        setStamp(message->received, *image);
        if (isAhead(message->received, *image)) return refused(message->received);
        return RecordedImage{image, message->received};
      }
      if (const auto compressed = message->as<sensor_msgs::CompressedImage>()) {
        setStamp(message->received, *compressed);
        if (isAhead(message->received, *compressed)) return refused(message->received);
        try {
          return RecordedImage{decodedImage(*compressed), message->received};
        } catch (const RefusedImage& error) {
          return RecordedImage{nullptr, message->received, error.what(), compressed->header.stamp};
        }
      }
      messages_.reject("an image message at " + std::to_string(message->received.toSec()) +
                       " s is not an image message");
    }
    return std::nullopt;
  }

  std::size_t total() const override { return messages_.total(); }
  std::string damage() const override { return messages_.damage("images"); }
  std::string note() const override {
    if (without_stamp_ == 0) return {};
    return std::to_string(without_stamp_) + " images of " + topic_ +
           " have the stamp zero; the times of their arrival are used";
  }

 private:
  template <typename Message>
  bool isAhead(const ros::Time& received, const Message& message) {
    return stamps_.wrongWith(message.header.stamp, received) == ImageStamps::Wrong::ahead;
  }
  RecordedImage refused(const ros::Time& received) const {
    return {nullptr, received, stamps_.reason()};
  }
  template <typename Message>
  void setStamp(const ros::Time& received, Message& message) {
    if (!message.header.stamp.isZero()) return;
    message.header.stamp = received;
    ++without_stamp_;
  }

  void chooseTopic(const std::string& path, const std::string& given) {
    std::set<std::string> names;
    std::set<std::string> others;
    for (const bag::Topic& topic : messages_.topics()) {
      if (isImage(topic)) names.insert(topic.name);
      if (isOtherImage(topic)) others.insert(topic.name + " (" + topic.type + ")");
    }
    topic_ = bag::topicName(given);
    if (topic_.empty() && names.size() == 1) topic_ = *names.begin();
    const std::string raw = rawTopic(topic_);
    for (const std::string& name : {topic_, raw, raw + "/compressed", raw + "/compressedDepth"}) {
      if (names.count(name) == 0) continue;
      topic_ = name;
      return;
    }
    std::string has =
        given.empty() ? " has no single image topic" : " has no image on '" + topic_ + "'";
    has += "; its image topics: " + (names.empty() ? "none" : util::joined(names, ", "));
    if (names.size() > 1) has += "; choose one with --topic";
    if (!others.empty()) has += "; of types that are not read: " + util::joined(others, ", ");
    throw UnusableBag(path + has + whatIsDamaged());
  }

  std::string whatIsDamaged() const {
    const std::string damage = messages_.damage("images");
    return damage.empty() ? "" : "; the bag is damaged: " + damage;
  }

  BagMessages messages_;
  ImageStamps stamps_;
  std::size_t without_stamp_ = 0;
};

}  // namespace

BagMessages::BagMessages(const std::string& path) : file_(path) {}

std::set<bag::Topic> BagMessages::topics() const {
  std::set<bag::Topic> all;
  for (const auto& connection : file_.connections()) {
    all.insert(connection.second.begin(), connection.second.end());
  }
  return all;
}

void BagMessages::select(const Wanted& wanted, double start, double duration) {
  for (const auto& [connection, topics] : file_.connections()) {
    for (const bag::Topic& topic : topics) {
      if (wanted(topic)) connections_[connection].insert(topic);
    }
  }
  ros::Time first = ros::TIME_MAX;
  for (const bag::Chunk& chunk : file_.chunks()) {
    for (const auto& of : chunk.times) {
      for (const ros::Time& time : of.second) first = std::min(first, time);
    }
  }
  begin_ = later(first, start);
  end_ = duration < 0.0 ? ros::TIME_MAX : later(begin_, duration);
  for (std::size_t i = 0; i < file_.chunks().size(); ++i) {
    const std::vector<ros::Time> times = wantedTimes(file_.chunks()[i]);
    if (times.empty()) continue;
    total_ += times.size();
    order_.emplace_back(*std::min_element(times.begin(), times.end()), i);
  }
  std::sort(order_.begin(), order_.end());
}

void BagMessages::skipToLastChunk() {
  if (order_.size() > 1) order_.erase(order_.begin(), order_.end() - 1);
}

std::optional<RecordedMessage> BagMessages::next() {
  while (true) {
    while (unread_ < order_.size() &&
           (queue_.empty() || order_[unread_].first <= std::get<0>(queue_.begin()->first))) {
      enqueue(order_[unread_++].second);
    }
    if (queue_.empty()) return std::nullopt;
    const auto [time, chunk, number] = queue_.begin()->first;
    const std::uint32_t connection = queue_.begin()->second;
    queue_.erase(queue_.begin());
    current_ = contentsOf(chunk);
    // The chunk was read again, and now fewer of its messages could be read.
    if (number >= current_->messages.size()) continue;
    ++read_;
    return RecordedMessage{connections_.at(connection), time, current_->messages[number].data};
  }
}

void BagMessages::reject(const std::string& what) {
  --read_;
  file_.note(what);
}

std::string BagMessages::damage(const std::string& things) const {
  std::string what = file_.damage();
  std::size_t lost = expected_ - std::min(expected_, read_);
  for (const auto& of : file_.missing()) lost += connections_.count(of.first) > 0 ? of.second : 0;
  if (lost > 0) {
    return std::to_string(lost) + (lost == 1 ? " of the " : " ") + things + " lost; " + what;
  }
  if (what.empty()) return what;
  if (file_.hasIndex()) return "no " + things + " known to be lost; " + what;
  return "how many " + things + " are lost is not known, since the index at the end is missing; " +
         what;
}

std::vector<ros::Time> BagMessages::wantedTimes(const bag::Chunk& chunk) const {
  std::vector<ros::Time> wanted;
  for (const auto& connection : connections_) {
    const auto times = chunk.times.find(connection.first);
    if (times == chunk.times.end()) continue;
    std::copy_if(times->second.begin(), times->second.end(), std::back_inserter(wanted),
                 [this](const ros::Time& time) { return isWanted(time); });
  }
  return wanted;
}

void BagMessages::enqueue(std::size_t chunk) {
  const ContentsPtr contents = contentsOf(chunk);
  std::vector<ros::Time> found;
  for (std::size_t i = 0; i < contents->messages.size(); ++i) {
    const bag::Message& message = contents->messages[i];
    if (connections_.count(message.connection) == 0 || !isWanted(message.time)) continue;
    queue_[{message.time, chunk, i}] = message.connection;
    found.push_back(message.time);
  }
  std::vector<ros::Time> indexed = wantedTimes(file_.chunks()[chunk]);
  expected_ += std::max(indexed.size(), found.size());
  std::sort(indexed.begin(), indexed.end());
  std::sort(found.begin(), found.end());
  if (indexed != found) {
    file_.note("the index and the messages differ in the chunk at byte " +
               std::to_string(file_.chunks()[chunk].position));
  }
}

/// Returns the messages of a chunk. Keeps the last few chunks in memory, because messages from
/// several chunks may alternate in time.
BagMessages::ContentsPtr BagMessages::contentsOf(std::size_t chunk) {
  constexpr std::size_t kKept = 4;
  for (const auto& kept : kept_) {
    if (kept.first == chunk) return kept.second;
  }
  kept_.emplace_back(chunk,
                     std::make_shared<const bag::ChunkContents>(file_.read(file_.chunks()[chunk])));
  if (kept_.size() > kKept) kept_.pop_front();
  return kept_.back().second;
}

std::string cameraOf(const std::string& image_topic) {
  const std::string raw = rawTopic(image_topic);
  return raw.substr(0, raw.rfind('/'));
}

sensor_msgs::CameraInfo readCameraInfo(const std::string& path, const std::string& image_topic,
                                       const std::string& user) {
  const std::string name = cameraOf(image_topic) + "/camera_info";
  BagMessages messages(path);
  messages.select([&name](const bag::Topic& topic) { return topic.name == name; });
  boost::shared_ptr<sensor_msgs::CameraInfo> first;
  while (const auto message = messages.next()) {
    const auto info = message->as<sensor_msgs::CameraInfo>();
    if (info && info->K[0] != 0.0) return *info;
    if (!first) first = info;
  }
  if (first) return *first;
  throw UnusableBag(path + ": it has no camera_info on '" + name + "', which " + user + " needs");
}

std::string changeOfCameraInfo(const std::string& path, const std::string& image_topic,
                               const sensor_msgs::CameraInfo& used) {
  const std::string name = cameraOf(image_topic) + "/camera_info";
  BagMessages messages(path);
  messages.select([&name](const bag::Topic& topic) { return topic.name == name; });
  messages.skipToLastChunk();
  boost::shared_ptr<sensor_msgs::CameraInfo> last;
  while (const auto message = messages.next()) {
    const auto info = message->as<sensor_msgs::CameraInfo>();
    if (info && info->K[0] != 0.0) last = info;
  }
  if (!last) return {};
  last->header = used.header;
  if (*last == used) return {};
  return util::format(
      "the camera_info on %s changes: fx, cx, cy are %.1f, %.1f, %.1f px at first and %.1f, %.1f, "
      "%.1f px at the end; the first one is used for all images; expected a bag for each (rosbag "
      "filter)",
      name.c_str(), used.K[0], used.K[2], used.K[5], last->K[0], last->K[2], last->K[5]);
}

std::unique_ptr<ImageSource> openBag(const std::string& path, const BagSelection& selection) {
  return std::make_unique<BagImages>(path, selection);
}

}  // namespace ktgp_orb
