#pragma once

#include <diagnostic_updater/diagnostic_updater.h>
#include <dynamic_reconfigure/server.h>
#include <image_transport/image_transport.h>
#include <ktgp_orb/HomographyStamped.h>
#include <ros/ros.h>

#include <Eigen/Core>
#include <atomic>
#include <boost/thread/recursive_mutex.hpp>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>

#include "nodelet/callback_thread.h"
#include "nodelet/consumer_monitor.h"
#include "nodelet/frame_inbox.h"
#include "nodelet/image_nodelet.h"
#include "nodelet/image_store.h"

namespace ktgp_orb {

/// Base of nodelets that use images and the matcher's homographies. They subscribe while they have
/// subscribers, callbacks only store, one worker thread does the work, and they can be unloaded at
/// any time. As in the matcher, callbacks have their own queues and threads.
///
/// A derived class calls stop() first in its destructor.
class FrameConsumer : public ImageNodelet {
 public:
  ~FrameConsumer() override;

 protected:
  /// Reads the parameters, and creates what the worker needs. Throws for unusable parameters.
  virtual void configure() = 0;
  /// Advertises all outputs.
  virtual void advertise() = 0;
  /// Ends services and the parameter server, after the callbacks have ended.
  virtual void shutdown() = 0;
  /// Called by the worker with everything that has arrived since the last call.
  virtual void work(FrameInbox::Content& content) = 0;
  /// Called by the worker when there was no subscriber for a while.
  virtual void restart() = 0;

  void stop();
  ros::NodeHandle privateNode(CallbackThread& queue) const;
  /// Calls `changed` with the parameters at once, and whenever they change. Throws if the initial
  /// ones are out of their range; later unusable ones are refused, and the old ones stay.
  template <typename Config>
  std::unique_ptr<dynamic_reconfigure::Server<Config>> serveParameters(
      const std::function<void(const Config&)>& changed) {
    checkParameters<Config>(private_node_);
    auto server =
        std::make_unique<dynamic_reconfigure::Server<Config>>(reconfigure_mutex_, private_node_);
    const auto last = std::make_shared<Config>();
    server->setCallback([this, changed, last](Config& config, std::uint32_t /*level*/) {
      try {
        requireFinite(config);
        setMaxMemory(config.max_memory);
        changed(config);
        *last = config;
        monitor_.setParameterError("");
      } catch (const std::invalid_argument& error) {
        sayParametersRefused(error.what());
        config = *last;
      }
    });
    return server;
  }
  /// Starts the worker without a message, for example to draw.
  void wake() { inbox_.wake(); }
  /// Reports it in diagnostics and, with limited frequency, in the log.
  void refuse(const std::string& reason);

  /// An image that waits for its homography.
  void keep(const sensor_msgs::ImageConstPtr& image);

  CallbackThread queue_;       // connections, parameters
  CallbackThread data_queue_;  // images, homographies
  CallbackThread slow_queue_;  // diagnostics and the watch, which ask the master
  ConsumerMonitor monitor_;
  std::string homography_topic_;
  ImageStore images_{kImages};  // used only by the worker

  static constexpr std::size_t kImages = 40;  // that wait for their homography: more than a second

 private:
  void start() override;
  void setMaxMemory(int megabytes);
  void sayParametersRefused(const std::string& reason);
  void subscribe() override;
  void unsubscribe() override;
  void tick();
  void run();

  boost::recursive_mutex reconfigure_mutex_;
  ros::NodeHandle node_;
  ros::NodeHandle data_node_;
  ros::NodeHandle private_node_;
  std::unique_ptr<image_transport::ImageTransport> transport_;
  std::unique_ptr<InputWatch> homography_watch_;  // used only in the slow queue
  ros::WallTimer timer_;
  std::unique_ptr<diagnostic_updater::Updater> diagnostics_;

  image_transport::Subscriber image_sub_;
  ros::Subscriber homography_sub_;

  boost::weak_ptr<const sensor_msgs::Image> last_image_;      // used only in the data queue
  boost::weak_ptr<const HomographyStamped> last_homography_;  // the same
  bool said_rectified_ = false;                               // the same
  std::atomic<std::size_t> store_bytes_{0};                   // limit for images_
  std::atomic<bool> restart_{false};
  FrameInbox inbox_;
  std::thread worker_;
};

/// Nanoseconds, as in the core.
std::int64_t stampOf(const ros::Time& time);
ros::Time timeOf(std::int64_t nanoseconds);
/// The homography of the message; empty if none was found.
std::optional<Eigen::Matrix3d> homographyOf(const HomographyStamped& message);

}  // namespace ktgp_orb
