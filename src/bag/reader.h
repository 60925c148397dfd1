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

/// A message of a bag. It is valid until the next message is read.
struct RecordedMessage {
  std::set<bag::Topic> topics;  ///< one topic; several if the damaged bag contradicts itself
  ros::Time received;
  std::string_view bytes;

  const std::string& topic() const { return topics.begin()->name; }

  /// Deserialises the message. Returns null if it has another type or is damaged.
  template <typename Message>
  boost::shared_ptr<Message> as() const {
    const std::string type = ros::message_traits::datatype<Message>();
    const bool is_of_type = std::any_of(topics.begin(), topics.end(), bag::isOf<Message>);
    if (!is_of_type || !bag::isWellFormed(type, bytes)) return nullptr;
    // ROS's input stream does not accept const data, but deserialize() only reads from it.
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

/// Reads the messages of selected topics from a bag, in the order of their times. The bag may be
/// damaged. Sorts the chunks by the times of their first messages, and reads a chunk only when it
/// may contain the next message.
class BagMessages {
 public:
  using Wanted = std::function<bool(const bag::Topic&)>;

  /// Throws UnusableBag if the file is not a bag.
  explicit BagMessages(const std::string& path);

  std::set<bag::Topic> topics() const;
  /// Call this once, before next(), to select topics (`wanted`) and a time. `start`: seconds after
  /// the beginning of the bag. `duration`: seconds; negative: to the end of the bag.
  void select(const Wanted& wanted, double start = 0.0, double duration = -1.0);
  /// Call this before next() to read only the messages of the last chunk.
  void skipToLastChunk();
  /// Number of selected messages, according to the index.
  std::size_t total() const { return total_; }

  /// Reads the next intact message; returns nothing at the end.
  std::optional<RecordedMessage> next();
  /// Call this if the last message from next() is damaged: damage() then counts it as lost and
  /// shows the text `what` to users.
  void reject(const std::string& what);

  /// Text for users about the problems so far; empty if there were none. Begins with the number of
  /// lost messages, if it is known. `things`: what users call the messages, for example "images".
  std::string damage(const std::string& things) const;

 private:
  using ContentsPtr = std::shared_ptr<const bag::ChunkContents>;
  using Key = std::tuple<ros::Time, std::size_t, std::size_t>;  // time, chunk, index in the chunk

  bool isWanted(const ros::Time& time) const { return time >= begin_ && time <= end_; }
  std::vector<ros::Time> wantedTimes(const bag::Chunk& chunk) const;
  void enqueue(std::size_t chunk);
  ContentsPtr contentsOf(std::size_t chunk);

  bag::BagFile file_;
  // The topics of each wanted connection.
  std::map<std::uint32_t, std::set<bag::Topic>> connections_;
  ros::Time begin_;
  ros::Time end_;
  std::size_t total_ = 0;
  // For each chunk with wanted messages: the time of the first one, and the number of the chunk.
  std::vector<std::pair<ros::Time, std::size_t>> order_;
  std::size_t unread_ = 0;              // index in order_ of the first unread chunk
  std::map<Key, std::uint32_t> queue_;  // queued messages with their connections
  std::list<std::pair<std::size_t, ContentsPtr>> kept_;
  ContentsPtr current_;       // chunk of the last message
  std::size_t expected_ = 0;  // number of messages that the chunks read so far should contain
  std::size_t read_ = 0;
};

struct RecordedImage {
  sensor_msgs::ImageConstPtr image;  ///< null if the image cannot be decoded
  ros::Time received;
  std::string problem{};  ///< reason why `image` is null
  ros::Time stamp{};      ///< stamp of the image if `image` is null; zero: not known
  /// Width and height of `image`, divided by those in the file; below 1 if it was shrunk.
  double x_scale = 1.0;
  double y_scale = 1.0;
};

/// The images of a recording (one topic of a bag, a video, or picture files) in the order of their
/// times.
class ImageSource {
 public:
  virtual ~ImageSource() = default;
  /// Reads the next image; returns nothing at the end. Throws only if memory runs out.
  virtual std::optional<RecordedImage> next() = 0;
  /// Number of images, according to the index of the bag or the header of the video.
  virtual std::size_t total() const = 0;
  /// The topic of the images. For videos and picture files, it is the topic that cameras usually
  /// use.
  const std::string& topic() const { return topic_; }
  /// Text for users about the problems in the part that was read; empty if there were none. Begins
  /// with the number of lost images, if it is known.
  virtual std::string damage() const = 0;
  /// A text that tells users how we understood an ambiguous input; empty if nothing was ambiguous.
  virtual std::string note() const { return {}; }

 protected:
  std::string topic_ = "/camera/image_raw";
};

struct BagSelection {
  std::string topic;       ///< empty: the only image topic of the bag
  double start = 0.0;      ///< seconds after the beginning of the bag
  double duration = -1.0;  ///< seconds; negative: to the end of the bag
};

/// Opens the images (sensor_msgs/Image or CompressedImage) of one topic of a bag, which may be
/// damaged. Throws UnusableBag if the file is not a bag, if the topic has no images in the selected
/// time, or if no topic is given and the bag does not have exactly one image topic. The text of the
/// error lists the image topics.
std::unique_ptr<ImageSource> openBag(const std::string& path, const BagSelection& selection);

/// Namespace of the camera that publishes the image topic, for example "/camera" for
/// "/camera/image_raw". The images of the topic may also be compressed.
std::string cameraOf(const std::string& image_topic);

/// Reads the camera_info that belongs to the image topic. Returns the first message with a
/// calibration, or the first message if none has a calibration. Throws UnusableBag if there is no
/// camera_info. `user`: name of the option or function that needs it, for the error text.
sensor_msgs::CameraInfo readCameraInfo(const std::string& path, const std::string& image_topic,
                                       const std::string& user);
/// Text for users if the last camera_info of the bag differs from `used`; otherwise empty. Does not
/// compare the messages in between, because that would take as long as reading the whole bag.
std::string changeOfCameraInfo(const std::string& path, const std::string& image_topic,
                               const sensor_msgs::CameraInfo& used);

}  // namespace ktgp_orb
