#pragma once

#include <dynamic_reconfigure/server.h>
#include <image_transport/image_transport.h>
#include <ktgp_orb/KtgpConfig.h>
#include <ktgp_orb/MatchPair.h>
#include <ros/ros.h>
#include <std_srvs/Trigger.h>

#include <atomic>
#include <boost/thread/recursive_mutex.hpp>
#include <chrono>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "messages/message_matcher.h"
#include "messages/rate_limiter.h"
#include "nodelet/callback_thread.h"
#include "nodelet/file_state.h"
#include "nodelet/image_nodelet.h"
#include "nodelet/matcher_monitor.h"
#include "nodelet/newest_slot.h"
#include "nodelet/sequence_numbers.h"

namespace ktgp_orb {

/// Message after a restart that lost a fixed reference taken from the camera.
constexpr const char* kReferenceLost =
    "the reference that ~set_reference took is lost, since the process that had it ended: call "
    "~set_reference again, or ~reset";

/// The matcher as a ROS nodelet. doc/topics.md describes topics and services.
///
/// Threads: callbacks only store (the newest image, a configuration, a request). One worker thread
/// takes the newest image, applies everything stored before it, matches and publishes.
///
/// The callbacks run in the nodelet's own queues and threads, not in the manager's. Slow work
/// (reading a reference image, asking the master) has its own queues, so that images and services
/// do not wait for it.
///
/// matcher_inputs.cpp has the functions for inputs, matcher_services.cpp those for services,
/// matcher_nodelet.cpp the rest.
class MatcherNodelet : public ImageNodelet {
 public:
  MatcherNodelet() = default;
  ~MatcherNodelet() override;

 private:
  void start() override;
  void stop();
  void advertise();
  template <typename Message, typename Pick>
  void advertiseOfFrames(const std::string& topic, const Pick& pick);
  void startReconfigure();
  void startTimers();

  // matcher_inputs.cpp
  bool isWanted() const override;
  void subscribe() override;
  void unsubscribe() override;

  void imageArrived(const sensor_msgs::ImageConstPtr& image);
  bool isSkipped(const sensor_msgs::Image& image);
  void countLost(std::uint32_t sequence_number);
  void subscribeSideInputs();
  void subscribeCameraInfo();
  void cameraInfoArrived(const sensor_msgs::CameraInfoConstPtr& info);
  void maskArrived(const sensor_msgs::ImageConstPtr& image);
  void referenceArrived(const sensor_msgs::ImageConstPtr& image);
  void watchInput();
  void report();
  void reportReference();
  void rereadReference(bool at_once);

  void reconfigured(KtgpConfig& config);
  void configureFrom(const KtgpConfig& config);
  void change(const std::function<void(Configuration&)>& edit);

  void work();
  void applyRequests(std::uint64_t arrival);
  void processImage(const sensor_msgs::ImageConstPtr& image);
  void publish(const FrameMessages& messages);
  void warnOfRawPoints(const FrameMessages& messages);
  std::string whyNoLens() const;
  void publishOverlay();
  void refuse(const std::string& reason);

  /// An image and its number among all arrived images.
  struct Arrival {
    sensor_msgs::ImageConstPtr image;
    std::uint64_t number = 0;
  };

  /// Requests of services and connections to the worker.
  struct Requests {
    bool forget_reference = false;
    bool reset = false;
    /// The first image that arrives after this many becomes the fixed reference.
    std::optional<std::uint64_t> fix_reference_after;
  };

  // matcher_services.cpp
  using Trigger = std_srvs::Trigger;
  void advertiseServices();
  bool matchPair(MatchPair::Request& request, MatchPair::Response& response);
  void pause();
  void resume();
  bool reset(Trigger::Request& request, Trigger::Response& response);
  bool setReference(Trigger::Request& request, Trigger::Response& response);
  bool pauseRequested(Trigger::Request& request, Trigger::Response& response);
  bool resumeRequested(Trigger::Request& request, Trigger::Response& response);
  std::string whyNoReferenceCanBeSet();

  // ROS side
  CallbackThread queue_;          // connections, parameters, ~mask, ~reference, camera_info
  CallbackThread image_queue_;    // images
  CallbackThread service_queue_;  // services that only store a request: never blocked
  CallbackThread slow_queue_;     // diagnostics and the watch, which ask the master
  CallbackThread pair_queue_;     // ~match_pair
  ros::NodeHandle node_;
  ros::NodeHandle image_node_;
  ros::NodeHandle private_node_;
  std::unique_ptr<image_transport::ImageTransport> transport_;
  std::vector<std::function<void(const FrameMessages&)>>
      frame_outputs_;  // each publishes one topic
  image_transport::Publisher overlay_pub_;
  std::vector<ros::ServiceServer> services_;
  ros::WallTimer watch_timer_;
  ros::WallTimer report_timer_;
  ros::WallTimer file_timer_;   // checks whether the reference_image has changed
  ros::WallTimer reset_timer_;  // the same, once, after ~reset
  std::unique_ptr<diagnostic_updater::Updater> diagnostics_;
  boost::recursive_mutex reconfigure_mutex_;
  KtgpConfig config_;  // the source of configuration_
  bool configured_ = false;
  std::string refusal_;  // why the initial parameters cannot be used
  std::unique_ptr<dynamic_reconfigure::Server<KtgpConfig>> reconfigure_server_;

  image_transport::Subscriber image_sub_;
  ros::Subscriber camera_info_sub_;
  ros::Subscriber mask_sub_;
  ros::Subscriber reference_sub_;
  std::atomic<bool> lazy_{true};
  std::atomic<bool> listening_{false};        // copy of subscribed_ that needs no lock
  std::atomic<std::uint32_t> publishers_{0};  // of the input, at the last watch
  std::atomic<bool> new_subscription_{false};
  std::atomic<double> max_rate_{0.0};  // Hz

  // Used only in the image queue
  SequenceNumbers sequence_numbers_;
  RateLimiter rate_limiter_;
  boost::weak_ptr<const sensor_msgs::Image> last_arrived_;

  // Used only in the first queue
  LensConstPtr lens_;  // of the last camera_info
  sensor_msgs::ImageConstPtr file_reference_;
  FileState file_state_;  // of the reference_image when it was read
  FileState file_seen_;   // at the last check

  // Used only in the slow queue
  bool remembers_reference_ = false;  // the master stores that ~set_reference took one

  // Shared with the worker
  std::atomic<bool> holds_set_reference_{false};  // the reference was taken by ~set_reference
  std::atomic<bool> reference_lost_{false};       // the previous process held such a reference
  std::mutex state_mutex_;  // guards configuration_ and requests_; never held while waiting
  Configuration configuration_;
  Requests requests_;
  std::atomic<bool> paused_{false};
  std::atomic<std::uint64_t> arrivals_{0};
  NewestSlot<Arrival> newest_;
  MatcherMonitor monitor_;

  // Used only by the worker
  std::unique_ptr<MessageMatcher> matcher_;
  std::string said_raw_points_;
  std::chrono::steady_clock::time_point last_overlay_;
  std::thread worker_;
};

}  // namespace ktgp_orb
