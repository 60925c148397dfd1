#include "bag/reader.h"

#include <sensor_msgs/CompressedImage.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <list>
#include <map>
#include <set>
#include <tuple>
#include <utility>
#include <vector>

#include "bag/file.h"
#include "messages/image_conversion.h"

namespace ktgp_orb {
namespace {

constexpr char kRaw[] = "sensor_msgs/Image";
constexpr char kCameraInfo[] = "sensor_msgs/CameraInfo";
constexpr char kCompressed[] = "sensor_msgs/CompressedImage";

std::set<std::string> imageTopics(const bag::BagFile& file) {
  std::set<std::string> names;
  for (const auto& connection : file.connections()) {
    for (const bag::Topic& topic : connection.second) {
      if (topic.type == kRaw || topic.type == kCompressed) names.insert(topic.name);
    }
  }
  return names;
}

std::set<std::uint32_t> connectionsOf(const bag::BagFile& file, const std::string& name,
                                      const std::string& type) {
  std::set<std::uint32_t> found;
  for (const auto& connection : file.connections()) {
    for (const bag::Topic& topic : connection.second) {
      if (topic.name == name && topic.type == type) found.insert(connection.first);
    }
  }
  return found;
}

std::string joined(const std::set<std::string>& names) {
  std::string list;
  for (const std::string& name : names) list += (list.empty() ? "" : ", ") + name;
  return list.empty() ? "none" : list;
}

bag::BagFile openFile(const std::string& path) {
  try {
    return bag::BagFile(path);
  } catch (const std::runtime_error& error) {
    throw UnusableBag(error.what());
  }
}

template <typename Message>
boost::shared_ptr<Message> deserialised(bag::View bytes) {
  auto message = boost::make_shared<Message>();
  // ROS has no stream of constant data; this one is only read.
  ros::serialization::IStream stream(const_cast<std::uint8_t*>(bytes.data),
                                     static_cast<std::uint32_t>(bytes.size));
  ros::serialization::deserialize(stream, *message);
  return message;
}

/// Reads chunks in the order of their first images, and only as many as needed to know the next
/// image.
class BagImages : public ImageSource {
 public:
  BagImages(const std::string& path, const BagSelection& selection) : file_(openFile(path)) {
    chooseTopic(path, selection.topic);
    chooseTime(selection);
    for (std::size_t i = 0; i < file_.chunks().size(); ++i) {
      const std::vector<ros::Time> times = wantedTimes(file_.chunks()[i]);
      if (times.empty()) continue;
      total_ += times.size();
      order_.emplace_back(*std::min_element(times.begin(), times.end()), i);
    }
    std::sort(order_.begin(), order_.end());
    if (total_ == 0) {
      const std::string damage = file_.damage().text();
      throw UnusableBag(path + " has no image on '" + topic_ + "' in the selected time" +
                        (damage.empty() ? "" : "; the bag is damaged: " + damage));
    }
  }

  std::optional<RecordedImage> next() override {
    while (true) {
      while (unread_ < order_.size() &&
             (queue_.empty() || order_[unread_].first <= std::get<0>(queue_.begin()->first))) {
        enqueue(order_[unread_++].second);
      }
      if (queue_.empty()) return std::nullopt;
      const auto [time, chunk, number] = queue_.begin()->first;
      const std::uint32_t connection = queue_.begin()->second;
      queue_.erase(queue_.begin());
      const ContentsPtr contents = contentsOf(chunk);
      if (number >= contents->messages.size()) continue;  // the message was readable before
      if (auto image = imageOf(connection, contents->messages[number].data)) {
        ++read_;
        return RecordedImage{std::move(*image), time};
      }
      file_.damage().note("an image message at " + std::to_string(time.toSec()) +
                          " s is not an image message");
    }
  }

  std::size_t total() const override { return total_; }
  const std::string& topic() const override { return topic_; }

  std::string damage() const override {
    std::string what = file_.damage().text();
    std::size_t lost = expected_ - std::min(expected_, read_);
    for (const auto& of : file_.missing()) lost += connections_.count(of.first) > 0 ? of.second : 0;
    if (lost > 0) return std::to_string(lost) + " images lost; " + what;
    if (what.empty()) return what;
    return (file_.hasIndex()
                ? "no image known to be lost; "
                : "how many images are lost is not known, since the index at the end is "
                  "missing; ") +
           what;
  }

 private:
  using ContentsPtr = std::shared_ptr<const bag::ChunkContents>;
  using Key = std::tuple<ros::Time, std::size_t, std::size_t>;  // time, chunk, index in it

  void chooseTopic(const std::string& path, const std::string& wanted) {
    const std::set<std::string> names = imageTopics(file_);
    topic_ = wanted;
    if (topic_.empty() && names.size() == 1) topic_ = *names.begin();
    if (names.count(topic_) == 0) {
      const std::string has =
          wanted.empty() ? " has no single image topic" : " has no image on '" + wanted + "'";
      const std::string damage = file_.damage().text();
      throw UnusableBag(path + has + "; its image topics: " + joined(names) +
                        (damage.empty() ? "" : "; the bag is damaged: " + damage));
    }
    for (const auto& connection : file_.connections()) {
      for (const bag::Topic& topic : connection.second) {
        const bool image = topic.type == kRaw || topic.type == kCompressed;
        if (image && topic.name == topic_) connections_.insert(connection.first);
      }
    }
  }

  void chooseTime(const BagSelection& selection) {
    ros::Time first = ros::TIME_MAX;
    for (const bag::Chunk& chunk : file_.chunks()) {
      for (const auto& of : chunk.times) {
        for (const ros::Time& time : of.second) first = std::min(first, time);
      }
    }
    begin_ = later(first, selection.start);
    end_ = selection.duration < 0.0 ? ros::TIME_MAX : later(begin_, selection.duration);
  }

  /// Limited to the range of times.
  static ros::Time later(const ros::Time& time, double seconds) {
    if (time.toSec() + seconds >= ros::TIME_MAX.toSec()) return ros::TIME_MAX;
    return time + ros::Duration(seconds);
  }

  bool isWanted(const ros::Time& time) const { return time >= begin_ && time <= end_; }

  std::vector<ros::Time> wantedTimes(const bag::Chunk& chunk) const {
    std::vector<ros::Time> wanted;
    for (const std::uint32_t connection : connections_) {
      const auto times = chunk.times.find(connection);
      if (times == chunk.times.end()) continue;
      std::copy_if(times->second.begin(), times->second.end(), std::back_inserter(wanted),
                   [this](const ros::Time& time) { return isWanted(time); });
    }
    return wanted;
  }

  void enqueue(std::size_t chunk) {
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
      file_.damage().note("the index and the messages differ in the chunk at byte " +
                          std::to_string(file_.chunks()[chunk].position));
    }
  }

  /// The last few chunks are kept, since the images of several may alternate.
  ContentsPtr contentsOf(std::size_t chunk) {
    constexpr std::size_t kKept = 4;
    for (const auto& kept : kept_) {
      if (kept.first == chunk) return kept.second;
    }
    kept_.emplace_back(
        chunk, std::make_shared<const bag::ChunkContents>(file_.read(file_.chunks()[chunk])));
    if (kept_.size() > kKept) kept_.pop_front();
    return kept_.back().second;
  }

  /// Empty for bytes that are not a message; a null pointer for an image that cannot be decoded.
  std::optional<sensor_msgs::ImageConstPtr> imageOf(std::uint32_t connection, bag::View bytes) {
    for (const bag::Topic& topic : file_.connections().at(connection)) {
      if (topic.type == kRaw && bag::isWellFormedImage(bytes)) {
        return sensor_msgs::ImageConstPtr(deserialised<sensor_msgs::Image>(bytes));
      }
      if (topic.type == kCompressed && bag::isWellFormedCompressedImage(bytes)) {
        return decodedImage(*deserialised<sensor_msgs::CompressedImage>(bytes));
      }
    }
    return std::nullopt;
  }

  bag::BagFile file_;
  std::string topic_;
  std::set<std::uint32_t> connections_;  // of the topic
  ros::Time begin_;
  ros::Time end_;
  std::size_t total_ = 0;
  std::vector<std::pair<ros::Time, std::size_t>> order_;  // of the chunks with wanted images
  std::size_t unread_ = 0;                                // index in it
  std::map<Key, std::uint32_t> queue_;                    // images of chunks read: connection
  std::list<std::pair<std::size_t, ContentsPtr>> kept_;
  std::size_t expected_ = 0;  // images of the chunks read
  std::size_t read_ = 0;
};

}  // namespace

std::string cameraOf(std::string image_topic) {
  const std::string suffix = "/compressed";
  const std::size_t end = image_topic.size() - std::min(image_topic.size(), suffix.size());
  if (image_topic.compare(end, std::string::npos, suffix) == 0) image_topic.erase(end);
  return image_topic.substr(0, image_topic.rfind('/'));
}

sensor_msgs::CameraInfo readCameraInfo(const std::string& path, const std::string& image_topic) {
  const std::string topic = cameraOf(image_topic) + "/camera_info";
  bag::BagFile file = openFile(path);
  const std::set<std::uint32_t> connections = connectionsOf(file, topic, kCameraInfo);
  for (const bag::Chunk& chunk : file.chunks()) {
    if (connections.empty()) break;
    const bag::ChunkContents contents = file.read(chunk);
    for (const bag::Message& message : contents.messages) {
      if (connections.count(message.connection) == 0) continue;
      if (!bag::isWellFormedCameraInfo(message.data)) continue;
      return *deserialised<sensor_msgs::CameraInfo>(message.data);
    }
  }
  throw UnusableBag(path + ": it has no camera_info on '" + topic +
                    "', which rectify and --motion need");
}

std::unique_ptr<ImageSource> openBag(const std::string& path, const BagSelection& selection) {
  return std::make_unique<BagImages>(path, selection);
}

std::string damageOf(const std::string& path) {
  bag::BagFile file = openFile(path);
  for (const bag::Chunk& chunk : file.chunks()) {
    bag::Times found;
    const bag::ChunkContents contents = file.read(chunk);
    for (const bag::Message& message : contents.messages) {
      found[message.connection].push_back(message.time);
    }
    if (found != chunk.times) file.damage().note("the index and the messages differ");
  }
  return file.damage().text();
}

}  // namespace ktgp_orb
