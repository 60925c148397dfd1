#pragma once

#include <image_transport/image_transport.h>
#include <ros/ros.h>
#include <sensor_msgs/Image.h>

#include <atomic>
#include <boost/weak_ptr.hpp>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "nodelet/input_watch.h"

namespace ktgp_orb {

/// A topic that a nodelet listens to while its results are wanted. The callback runs in the queue
/// of the node handle. It gets each message only once, even if ROS delivers it twice: ROS may
/// connect a publisher and a subscriber of one process twice if they start at the same time.
class Input {
 public:
  virtual ~Input() = default;

  const std::string& topic() const { return topic_; }
  const std::string& what() const { return what_; }
  /// Number of messages since the start.
  std::uint64_t arrived() const { return arrived_; }
  virtual std::uint32_t publishers() const = 0;
  /// A disabled input does not subscribe, for example to a sensor that is not used.
  void enable(bool enabled) { enabled_ = enabled; }
  /// Subscribes or unsubscribes. Call it again after enable().
  void subscribe(bool wanted);

  /// The InputWatch of this input. Use it only in the slow queue, because it waits for the answers
  /// of the ROS master.
  InputWatch& watch() { return *watch_; }
  /// True if it is not reported that no message arrives.
  bool mayBeSilent() const { return may_be_silent_; }
  /// Sets the number of publishers of the topic; called in the slow queue.
  void setPublishers(std::uint32_t count) { known_publishers_ = count; }

 protected:
  Input(std::string topic, std::string what) : topic_(std::move(topic)), what_(std::move(what)) {}
  virtual void open() = 0;
  virtual void close() = 0;
  bool isNew(const boost::shared_ptr<const void>& message);

  std::string topic_;
  std::string what_;
  std::unique_ptr<InputWatch> watch_;
  bool may_be_silent_ = false;
  std::atomic<std::uint32_t> known_publishers_{0};

 private:
  std::atomic<bool> enabled_{true};
  bool subscribed_ = false;
  std::atomic<std::uint64_t> arrived_{0};
  boost::weak_ptr<const void> last_;  // last message; used only in the callback
};

template <typename Message>
class MessageInput : public Input {
 public:
  using Callback = std::function<void(const boost::shared_ptr<const Message>&)>;

  /// `is_watched`: report if nothing arrives; that several nodes publish is always reported.
  /// `queue_size`: see ros::NodeHandle::subscribe.
  MessageInput(const ros::NodeHandle& node, const std::string& name, const std::string& what,
               std::uint32_t queue_size, bool is_watched, Callback callback)
      : Input(node.resolveName(name), what),
        node_(node),
        queue_size_(queue_size),
        callback_(std::move(callback)) {
    may_be_silent_ = !is_watched;
    watch_ = std::make_unique<InputWatch>(topic_, ros::message_traits::datatype<Message>(), what);
  }
  std::uint32_t publishers() const override { return subscriber_.getNumPublishers(); }

 private:
  void open() override {
    const auto arrived = [this](const boost::shared_ptr<const Message>& message) {
      if (isNew(message)) callback_(message);
    };
    subscriber_ = node_.subscribe<Message>(
        topic_, queue_size_,
        boost::function<void(const boost::shared_ptr<const Message>&)>(arrived),
        ros::VoidConstPtr(), ros::TransportHints().tcpNoDelay());
  }
  void close() override { subscriber_.shutdown(); }

  ros::NodeHandle node_;
  std::uint32_t queue_size_;
  Callback callback_;
  ros::Subscriber subscriber_;
};

/// Counts lost images, using the publisher's counter (header.seq).
class SequenceNumbers {
 public:
  /// Number of images lost between the previous image and this one. 0 if the counter does not
  /// increase, because it restarted or the publisher does not count, or if the gap exceeds kMost.
  std::uint32_t lostBefore(std::uint32_t number) {
    const std::optional<std::uint32_t> before = last_;
    last_ = number;
    if (!before || number <= *before) return 0;
    const std::uint32_t lost = number - *before - 1;
    return lost <= kMost ? lost : 0;
  }

  /// Makes the next lostBefore() return 0.
  void restart() { last_.reset(); }

 private:
  static constexpr std::uint32_t kMost = 1000;  // a larger gap means another publisher's counter

  std::optional<std::uint32_t> last_;
};

/// The images on a node's topic `image`, received with the transport that the parameter
/// ~image_transport names. If the topic ends in /compressed, the transport is compressed, whatever
/// the parameter says. Prefers this package's decoder to the decoder of compressed_image_transport.
class ImageInput : public Input {
 public:
  /// `lost`: number of images that were sent, according to header.seq, but did not arrive.
  using Callback = std::function<void(const sensor_msgs::ImageConstPtr& image, std::uint32_t lost)>;

  /// Reads the parameters only here, so that a later change of the parameters cannot make the
  /// running input fail. Throws std::invalid_argument if the transport is not installed; the text
  /// says what to do.
  ImageInput(const ros::NodeHandle& node, const ros::NodeHandle& private_node, int queue_size,
             Callback callback);
  std::uint32_t publishers() const override { return subscriber_.getNumPublishers(); }
  const std::string& transport() const { return transport_name_; }

 private:
  /// Removes "/compressed" from the topic's name, sets transport_name_, and returns the plugin.
  std::string choosePlugin();
  void open() override;
  void close() override { subscriber_.shutdown(); }
  std::uint32_t lostBefore(const sensor_msgs::Image& image);

  image_transport::ImageTransport transport_;
  std::string transport_name_;  // name of the image transport: raw, compressed, ...
  image_transport::TransportHints hints_;
  std::uint32_t queue_size_;
  Callback callback_;
  image_transport::Subscriber subscriber_;
  std::atomic<bool> is_new_subscription_{false};
  SequenceNumbers numbers_;  // used only in the callback
};

}  // namespace ktgp_orb
