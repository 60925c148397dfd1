#pragma once

#include <ros/serialization.h>
#include <ros/time.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <cstddef>
#include <functional>
#include <list>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <tuple>
#include <utility>
#include <vector>

#include "bag/file.h"

namespace ktgp_orb {

/// A message of a bag, valid until the next message is read.
struct RecordedMessage {
  std::set<bag::Topic> topics;  ///< several only if a damaged bag contradicts itself
  ros::Time received;
  std::string_view bytes;

  const std::string& topic() const { return topics.begin()->name; }

  /// The message; null if it has another type, or is damaged.
  template <typename Message>
  boost::shared_ptr<Message> as() const {
    const std::string type = ros::message_traits::datatype<Message>();
    const bool is_of_type = std::any_of(topics.begin(), topics.end(), bag::isOf<Message>);
    if (!is_of_type || !bag::isWellFormed(type, bytes)) return nullptr;
    // ROS has no input stream for const data, but deserialize() does not write to the stream.
    auto* const data = reinterpret_cast<std::uint8_t*>(const_cast<char*>(bytes.data()));
    ros::serialization::IStream stream(data, static_cast<std::uint32_t>(bytes.size()));
    auto message = boost::make_shared<Message>();
    try {
      ros::serialization::deserialize(stream, *message);
    } catch (const ros::serialization::StreamOverrunException&) {
      return nullptr;
    }
    return stream.getLength() == 0 ? message : nullptr;
  }
};

/// The messages of selected topics of a bag, which may be damaged, in the order of their times.
/// Reads the chunks in the order of their first messages. Reads a chunk only when it may contain
/// the next message.
class BagMessages {
 public:
  using Wanted = std::function<bool(const bag::Topic&)>;

  /// Throws UnusableBag for a file that is not a bag.
  explicit BagMessages(const std::string& path);

  std::set<bag::Topic> topics() const;
  /// Call this once, before next(). `start`: seconds after the beginning of the bag. `duration`:
  /// seconds; a negative duration means to the end.
  void select(const Wanted& wanted, double start = 0.0, double duration = -1.0);
  /// Call this before next(): restricts the selection to the messages of the last chunk.
  void skipToLastChunk();
  /// Number of selected messages in the index.
  std::size_t total() const { return total_; }

  /// The next readable message; empty at the end.
  std::optional<RecordedMessage> next();
  /// Notes that the message returned last is damaged. `what`: text for users.
  void reject(const std::string& what);

  /// Text about the problems so far; empty for an intact bag. Begins with the number of lost
  /// messages if it is known. `things`: what users call the messages, for example "images".
  std::string damage(const std::string& things) const;

 private:
  using ContentsPtr = std::shared_ptr<const bag::ChunkContents>;
  using Key = std::tuple<ros::Time, std::size_t, std::size_t>;  // time, chunk, index in the chunk

  bool isWanted(const ros::Time& time) const { return time >= begin_ && time <= end_; }
  std::vector<ros::Time> wantedTimes(const bag::Chunk& chunk) const;
  void enqueue(std::size_t chunk);
  ContentsPtr contentsOf(std::size_t chunk);

  bag::BagFile file_;
  std::map<std::uint32_t, std::set<bag::Topic>> connections_;  // connections with wanted topics
  ros::Time begin_;
  ros::Time end_;
  std::size_t total_ = 0;
  // For each chunk with wanted messages: time of the first wanted message, and number of the chunk.
  std::vector<std::pair<ros::Time, std::size_t>> order_;
  std::size_t unread_ = 0;              // index in order_ of the next chunk
  std::map<Key, std::uint32_t> queue_;  // connection of each queued message
  std::list<std::pair<std::size_t, ContentsPtr>> kept_;
  ContentsPtr current_;       // chunk of the message returned last
  std::size_t expected_ = 0;  // number of messages that the chunks read so far should contain
  std::size_t read_ = 0;
};

struct RecordedImage {
  sensor_msgs::ImageConstPtr image;  ///< null if the image cannot be decoded
  ros::Time received;
  std::string problem{};  ///< the reason, if there is no image
};

/// The images of one topic of a bag, in the order of their times.
class ImageSource {
 public:
  virtual ~ImageSource() = default;
  /// The next readable image, or empty at the end. Throws only if memory runs out.
  virtual std::optional<RecordedImage> next() = 0;
  /// Number of images in the bag's index.
  virtual std::size_t total() const = 0;
  /// The topic of the images; for videos and pictures, the usual topic of a camera.
  const std::string& topic() const { return topic_; }
  /// Text about the problems in the part of the bag that was read; empty for an intact bag. Begins
  /// with the number of lost images if it is known.
  virtual std::string damage() const = 0;
  /// Tells users how an ambiguous input was interpreted; empty if nothing was ambiguous.
  virtual std::string note() const { return {}; }

 protected:
  std::string topic_ = "/camera/image_raw";
};

struct BagSelection {
  std::string topic;       ///< empty: the bag's only image topic
  double start = 0.0;      ///< s after the beginning of the bag
  double duration = -1.0;  ///< s; below 0: to the end of the bag
};

/// Opens the images (sensor_msgs/Image or CompressedImage) of one topic of a bag, damaged or not.
/// Throws UnusableBag if the file is not a bag, if the topic has no images in the selected time, or
/// if no topic is given and the bag does not have exactly one image topic. The error lists the
/// image topics.
std::unique_ptr<ImageSource> openBag(const std::string& path, const BagSelection& selection);

/// Namespace of the camera that publishes the image topic. Topics of compressed images are allowed,
/// too.
std::string cameraOf(const std::string& image_topic);

/// Reads the topic camera_info in the namespace of the image topic. Returns the first message with
/// a calibration, or the first message if none has a calibration. Throws UnusableBag if there is no
/// camera_info. `user`: name of the option or function that needs the camera_info.
sensor_msgs::CameraInfo readCameraInfo(const std::string& path, const std::string& image_topic,
                                       const std::string& user);
/// Text for users if the last camera_info of the bag differs from `used`; otherwise empty. Earlier
/// messages are not compared, since reading them would take as long as reading the whole bag.
std::string changeOfCameraInfo(const std::string& path, const std::string& image_topic,
                               const sensor_msgs::CameraInfo& used);

}  // namespace ktgp_orb
