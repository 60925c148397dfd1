#pragma once

#include <image_transport/transport_hints.h>
#include <nodelet/nodelet.h>
#include <ros/ros.h>

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "nodelet/input_watch.h"
#include "nodelet/outputs.h"
#include "nodelet/parameters.h"

namespace ktgp_orb {

/// Base of all nodelets that use images: subscribes to the input while an output is wanted, reads
/// the parameters of the input, and reports problems with the input, the parameters and single
/// images.
class ImageNodelet : public nodelet::Nodelet {
 protected:
  /// Creates everything; an exception is logged and ends the loading.
  virtual void start() = 0;
  /// Whether images are needed now.
  virtual bool isWanted() const { return outputs_.haveSubscribers(); }
  /// Start and stop the input; connect_mutex_ is locked, and subscribed_ is true in between.
  virtual void subscribe() = 0;
  virtual void unsubscribe() = 0;

  /// Subscribes or unsubscribes as needed; does nothing before connect().
  void connectionsChanged();
  /// Calls `advertise`, then lets the subscribers decide what is subscribed. So an early
  /// subscriber does not find only some of the outputs.
  void connect(const std::function<void()>& advertise);
  /// Ends the input; after this connectionsChanged() does nothing.
  void disconnect();
  bool isSubscribed();

  /// Reads the topic, the transport and the queue size once, at start, so that a later change
  /// cannot fail during the work. Throws if the transport is not installed.
  void openInput(const ros::NodeHandle& node, const ros::NodeHandle& private_node, int queue_size);
  /// Throws for initial parameters that are out of their range; logs unknown ones.
  template <typename Config>
  void checkParameters(const ros::NodeHandle& private_node) {
    requireAllInRange<Config>(private_node);
    sayUnknown(unknownParameters<Config>(private_node));
  }
  /// Logs why an image is refused, with limited frequency. Call it from one thread at a time.
  void sayRefused(const std::string& reason);
  /// Whether ROS time is simulated and has not moved since the last call.
  bool clockStands();
  /// Whether ROS time is simulated and its clock never started.
  static bool clockIsMissing() { return ros::Time::isSimTime() && ros::Time::now().isZero(); }
  /// Warns about an input without messages, except while the clock stands.
  void watch(InputWatch& watch, bool subscribed, std::uint64_t arrived, std::uint32_t publishers);
  /// Reports once that several nodes publish the images; returns the message, or empty.
  std::string watchMixture(std::uint32_t publishers);

  std::string image_topic_;
  std::string camera_info_topic_;
  std::uint32_t queue_size_ = 1;
  std::unique_ptr<image_transport::TransportHints> transport_hints_;
  std::unique_ptr<InputWatch> image_watch_;
  Outputs outputs_;
  std::mutex connect_mutex_;  // guards the subscriptions and subscribed_
  bool subscribed_ = false;

 private:
  void onInit() final;
  void sayUnknown(const std::vector<std::string>& parameters);

  bool connected_ = false;
  std::chrono::steady_clock::time_point last_refusal_;
  ros::Time last_time_;  // at the last clockStands()
  bool clock_stands_ = false;
  bool said_mixture_ = false;
};

}  // namespace ktgp_orb
