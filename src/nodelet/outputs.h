#pragma once

#include <image_transport/image_transport.h>
#include <ros/ros.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace ktgp_orb {

/// Publishers of a nodelet in its private namespace. Tells whether any of them has a subscriber,
/// and can shut down all of them.
class Outputs {
 public:
  using Callback = std::function<void()>;

  /// `node`: the private node handle, whose callback queue handles new connections. `changed` is
  /// called when a subscriber is added or removed.
  void open(const ros::NodeHandle& node, Callback changed);

  template <typename Message>
  ros::Publisher advertise(const std::string& topic, std::uint32_t queue_size) {
    const auto changed = [this](const ros::SingleSubscriberPublisher&) { changed_(); };
    topics_.push_back(node_.advertise<Message>(topic, queue_size, changed, changed));
    return topics_.back();
  }
  /// When a subscriber is added, calls `changed` (see open()) and then `came`.
  image_transport::Publisher advertiseImage(
      const std::string& topic, std::uint32_t queue_size, bool latch = false,
      const Callback& came = [] {});

  bool haveSubscribers() const;
  void shutdown();

 private:
  ros::NodeHandle node_;
  std::unique_ptr<image_transport::ImageTransport> transport_;
  Callback changed_;
  std::vector<ros::Publisher> topics_;
  std::vector<image_transport::Publisher> images_;
};

}  // namespace ktgp_orb
