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

/// What all nodelets have in common that take images: they subscribe to their input while an output
/// is wanted, read the same parameters of the input and say what is wrong with it, with their
/// parameters and with an image in the same words.
class ImageNodelet : public nodelet::Nodelet {
 protected:
  /// Makes everything; what it throws is said in the log and ends the loading.
  virtual void start() = 0;
  /// Whether there is a reason to look at images now.
  virtual bool isWanted() const { return outputs_.haveSubscribers(); }
  /// Begin and end of the input; connect_mutex_ is locked, subscribed_ is true in between.
  virtual void subscribe() = 0;
  virtual void unsubscribe() = 0;

  /// Subscribes or unsubscribes as is wanted now; nothing before connect().
  void connectionsChanged();
  /// Calls `advertise`, then lets subscribers decide what is subscribed. An early subscriber does
  /// not find half of the outputs.
  void connect(const std::function<void()>& advertise);
  /// Ends the input; connectionsChanged() does nothing any more.
  void disconnect();
  bool isSubscribed();

  /// Reads the topic, the transport and the queue size, once: what is set later cannot fail in the
  /// middle of the work. Throws where the transport is not installed.
  void openInput(const ros::NodeHandle& node, const ros::NodeHandle& private_node, int queue_size);
  /// Throws for parameters at the start that are out of their range; names unknown ones in the log.
  template <typename Config>
  void checkParameters(const ros::NodeHandle& private_node) {
    requireAllInRange<Config>(private_node);
    sayUnknown(unknownParameters<Config>(private_node));
  }
  /// Says in the log why an image is refused, not too often. One thread at a time.
  void sayRefused(const std::string& reason);
  /// Whether the clock is a simulated one that has not moved since the last call.
  bool clockStands();
  /// Whether the clock is a simulated one that never began.
  static bool clockIsMissing() { return ros::Time::isSimTime() && ros::Time::now().isZero(); }
  /// Warns of an input where nothing comes, but for the time that a clock stands.
  void watch(InputWatch& watch, bool subscribed, std::uint64_t arrived, std::uint32_t publishers);
  /// Says once that several nodes publish the images; the sentence, or empty.
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
  ros::Time last_time_;  // as of the last clockStands()
  bool clock_stands_ = false;
  bool said_mixture_ = false;
};

}  // namespace ktgp_orb
