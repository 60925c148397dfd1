#pragma once

#include <image_transport/transport_hints.h>
#include <nodelet/nodelet.h>
#include <ros/ros.h>

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "nodelet/input_watch.h"
#include "nodelet/parameters.h"

namespace ktgp_orb {

/// What all nodelets have in common that take images: they read the same parameters of the input
/// and say what is wrong with it, with their parameters and with an image in the same words.
class ImageNodelet : public nodelet::Nodelet {
 protected:
  /// Makes everything; what it throws is said in the log and ends the loading.
  virtual void start() = 0;

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

 private:
  void onInit() final;
  void sayUnknown(const std::vector<std::string>& parameters);

  std::chrono::steady_clock::time_point last_refusal_;
  ros::Time last_time_;  // as of the last clockStands()
  bool clock_stands_ = false;
  bool said_mixture_ = false;
};

}  // namespace ktgp_orb
