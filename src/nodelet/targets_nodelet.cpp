#include <diagnostic_updater/diagnostic_updater.h>
#include <dynamic_reconfigure/server.h>
#include <ktgp_orb/DetectTargets.h>
#include <ktgp_orb/RemoveTarget.h>
#include <ktgp_orb/SetTarget.h>
#include <ktgp_orb/TargetsConfig.h>
#include <sensor_msgs/image_encodings.h>
#include <tf2_ros/transform_broadcaster.h>
#include <pluginlib/class_list_macros.hpp>

#include <atomic>
#include <boost/make_shared.hpp>
#include <boost/thread/recursive_mutex.hpp>

#include "ktgp_orb/overlay.h"
#include "messages/image_conversion.h"
#include "messages/target_messages.h"
#include "nodelet/callback_thread.h"
#include "nodelet/image_nodelet.h"
#include "nodelet/target_book.h"
#include "nodelet/targets_monitor.h"

namespace ktgp_orb {

/// Images in, flat targets out. doc/targets.md describes topics, services and parameters.
/// Everything but the diagnostics runs in one thread.
class TargetsNodelet : public ImageNodelet {
 public:
  ~TargetsNodelet() override;

 private:
  void start() override;
  bool isWanted() const override { return outputs_.haveSubscribers() || sends_tf_; }
  void subscribe() override;
  void unsubscribe() override;
  void configure(TargetsConfig& config);
  void advertise(ros::NodeHandle& private_node);
  void loadNext();
  void targetsChanged();
  void onImage(const sensor_msgs::ImageConstPtr& image);
  void search(const sensor_msgs::ImageConstPtr& image);
  void publish(const TargetDetectionsPtr& message, const cv::Mat& grey, const TargetFrame& frame);
  void say(const std::string& problem);
  std::string sayAmbiguity(const std::string& id);
  bool add(SetTarget::Request& request, SetTarget::Response& response);
  bool replace(SetTarget::Request& request, SetTarget::Response& response);
  bool remove(RemoveTarget::Request& request, RemoveTarget::Response& response);
  bool detect(DetectTargets::Request& request, DetectTargets::Response& response);
  void tick();

  template <typename Response, typename Change>
  bool change(Response& response, const Change& what) {
    try {
      what();
      response.success = true;
    } catch (const std::exception& error) {
      response.message = error.what();
      NODELET_WARN("a request is refused: %s", error.what());
    }
    targetsChanged();
    return true;
  }

  CallbackThread queue_;
  CallbackThread slow_queue_;  // diagnostics and the watch, which ask the master
  ros::NodeHandle node_;
  std::unique_ptr<image_transport::ImageTransport> transport_;
  boost::recursive_mutex reconfigure_mutex_;
  std::unique_ptr<dynamic_reconfigure::Server<TargetsConfig>> server_;
  std::vector<ros::ServiceServer> services_;
  image_transport::Subscriber image_sub_;
  ros::Subscriber info_sub_;
  ros::WallTimer load_;   // while targets are read
  ros::WallTimer timer_;  // of the diagnostics
  ros::Publisher detections_pub_;
  ros::Publisher markers_pub_;
  image_transport::Publisher image_pub_;
  std::unique_ptr<tf2_ros::TransformBroadcaster> broadcaster_;
  std::unique_ptr<diagnostic_updater::Updater> diagnostics_;
  TargetsMonitor monitor_;

  TargetsConfig config_;
  Pixels pixels_ = Pixels::raw;
  std::atomic<bool> sends_tf_{false};
  TargetFinder finder_;
  TargetBook book_{finder_};
  DetectedPose pose_;
  sensor_msgs::CameraInfoConstPtr info_;
  boost::weak_ptr<const sensor_msgs::Image> last_image_;
  ImageSequence sequence_;
  std::string said_;
};

TargetsNodelet::~TargetsNodelet() {
  for (CallbackThread* queue : {&queue_, &slow_queue_}) queue->stop();
  timer_.stop();
  load_.stop();
  disconnect();
  outputs_.shutdown();
  services_.clear();
  server_.reset();
}

void TargetsNodelet::start() {
  node_ = getNodeHandle();
  node_.setCallbackQueue(&queue_.callbacks);
  ros::NodeHandle private_node = getPrivateNodeHandle();
  private_node.setCallbackQueue(&queue_.callbacks);
  openInput(node_, private_node, 1);
  transport_ = std::make_unique<image_transport::ImageTransport>(node_);
  broadcaster_ = std::make_unique<tf2_ros::TransformBroadcaster>();
  outputs_.open(private_node, [this] { connectionsChanged(); });
  checkParameters<TargetsConfig>(private_node);
  server_ = std::make_unique<dynamic_reconfigure::Server<TargetsConfig>>(reconfigure_mutex_,
                                                                         private_node);
  server_->setCallback(
      [this](TargetsConfig& config, std::uint32_t /*level*/) { configure(config); });
  book_.open(config_.targets, config_.file);
  connect([&] { advertise(private_node); });
  diagnostics_ = std::make_unique<diagnostic_updater::Updater>(node_, private_node, getName());
  diagnostics_->setHardwareID(image_topic_);
  diagnostics_->add("targets", &monitor_, &TargetsMonitor::report);
  ros::NodeHandle slow_node = getNodeHandle();
  slow_node.setCallbackQueue(&slow_queue_.callbacks);
  timer_ = slow_node.createWallTimer(ros::WallDuration(1.0),
                                     [this](const ros::WallTimerEvent&) { tick(); });
  // One by one, so that the nodelet can be unloaded at any time.
  load_ = node_.createWallTimer(ros::WallDuration(0.001),
                                [this](const ros::WallTimerEvent&) { loadNext(); });
  connectionsChanged();
  for (CallbackThread* queue : {&queue_, &slow_queue_}) queue->start();
  NODELET_INFO("searches targets in images on %s (transport %s), calibration on %s",
               image_topic_.c_str(), transport_hints_->getTransport().c_str(),
               camera_info_topic_.c_str());
}

void TargetsNodelet::advertise(ros::NodeHandle& private_node) {
  detections_pub_ = outputs_.advertise<TargetDetections>("detections", 10);
  markers_pub_ = outputs_.advertise<visualization_msgs::MarkerArray>("markers", 2);
  image_pub_ = outputs_.advertiseImage("image", 2);
  services_ = {private_node.advertiseService("add", &TargetsNodelet::add, this),
               private_node.advertiseService("replace", &TargetsNodelet::replace, this),
               private_node.advertiseService("remove", &TargetsNodelet::remove, this),
               private_node.advertiseService("detect", &TargetsNodelet::detect, this)};
}

void TargetsNodelet::configure(TargetsConfig& config) {
  try {
    requireFinite(config);
    pixels_ = pixelsFrom(config.calibration, image_topic_);
    finder_.setSearch(config.search_ms, config.smallest_side, config.max_instances);
  } catch (const std::invalid_argument& error) {
    NODELET_ERROR("new parameters are refused, the old ones stay: %s", error.what());
    config = config_;
    return;
  }
  config_ = config;
  targetsChanged();
}

void TargetsNodelet::loadNext() {
  if (!book_.isLoading()) {
    load_.stop();
    NODELET_INFO("known targets: %zu", finder_.ids().size());
    return;
  }
  const std::string refused = book_.loadNext();
  if (!refused.empty()) {
    monitor_.targetRefused(refused);
    NODELET_ERROR("a target is refused: %s%s", refused.c_str(), book_.whereKept().c_str());
  }
  monitor_.setWaiting(book_.waiting());
  targetsChanged();
}

/// Listeners of tf are unknown, so frames are searched while a target has a frame.
void TargetsNodelet::targetsChanged() {
  sends_tf_ = config_.publish_tf && book_.hasFrames();
  connectionsChanged();
}

void TargetsNodelet::subscribe() {
  // As in FrameConsumer: within a process everything may arrive twice.
  image_sub_ = transport_->subscribe(
      image_topic_, queue_size_,
      [this](const sensor_msgs::ImageConstPtr& image) {
        if (last_image_.lock() == image) return;
        last_image_ = image;
        onImage(image);
      },
      ros::VoidPtr(), *transport_hints_);
  info_sub_ = node_.subscribe<sensor_msgs::CameraInfo>(
      camera_info_topic_, 1, [this](const sensor_msgs::CameraInfoConstPtr& info) { info_ = info; },
      ros::VoidConstPtr(), ros::TransportHints().tcpNoDelay());
}

void TargetsNodelet::unsubscribe() {
  image_sub_.shutdown();
  info_sub_.shutdown();
  info_.reset();
  finder_.restart();
}

void TargetsNodelet::onImage(const sensor_msgs::ImageConstPtr& image) {
  monitor_.imageArrived();
  try {
    search(image);
  } catch (const std::exception& error) {
    monitor_.refused(error.what());
    sayRefused(error.what());
  }
}

void TargetsNodelet::search(const sensor_msgs::ImageConstPtr& image) {
  const cv::Mat grey = greyImage(image);
  sequence_.next(image->header.stamp, grey.size(), finder_);
  const TargetFrame& frame = finder_.find(grey);
  const TargetDetectionsPtr message = toMessage(image->header, frame, config_.frame_prefix);
  addPoses(frame, grey.size(), info_.get(), camera_info_topic_, pixels_, pose_, *message);
  say(message->no_pose);
  publish(message, grey, frame);
  monitor_.done(*message);
}

void TargetsNodelet::publish(const TargetDetectionsPtr& message, const cv::Mat& grey,
                             const TargetFrame& frame) {
  detections_pub_.publish(message);
  if (markers_pub_.getNumSubscribers() > 0) markers_pub_.publish(markersOf(*message));
  if (config_.publish_tf) broadcaster_->sendTransform(transformsOf(*message));
  if (image_pub_.getNumSubscribers() == 0) return;
  const auto overlay = boost::make_shared<sensor_msgs::Image>();
  cv::Mat canvas;
  drawTargets(grey, frame.detections, canvas);
  overlay->header = message->header;
  overlay->encoding = sensor_msgs::image_encodings::BGR8;
  overlay->width = static_cast<std::uint32_t>(canvas.cols);
  overlay->height = static_cast<std::uint32_t>(canvas.rows);
  overlay->step = static_cast<std::uint32_t>(canvas.step);
  overlay->data.assign(canvas.datastart, canvas.dataend);
  image_pub_.publish(overlay);
}

/// Logs once why poses are missing; the diagnostics say it as long as it lasts.
void TargetsNodelet::say(const std::string& problem) {
  if (!problem.empty() && problem != said_) {
    NODELET_WARN("a target has no pose: %s", problem.c_str());
  }
  said_ = problem;
}

/// How the new target looks like itself in another pose, also in the log; else an empty text.
std::string TargetsNodelet::sayAmbiguity(const std::string& id) {
  std::string text = finder_.ambiguity(id);
  if (text.empty()) return text;
  text = "target \"" + id + "\" looks the same " + text +
         ": its pose is one of several, and is not sent to tf";
  NODELET_WARN("%s", text.c_str());
  return text;
}

bool TargetsNodelet::add(SetTarget::Request& request, SetTarget::Response& response) {
  return change(response, [&] {
    book_.add(request);
    response.message = sayAmbiguity(request.id);
  });
}

bool TargetsNodelet::replace(SetTarget::Request& request, SetTarget::Response& response) {
  return change(response, [&] {
    book_.replace(request);
    response.message = sayAmbiguity(request.id);
  });
}

bool TargetsNodelet::remove(RemoveTarget::Request& request, RemoveTarget::Response& response) {
  return change(response, [&] { book_.remove(request.id); });
}

bool TargetsNodelet::detect(DetectTargets::Request& request, DetectTargets::Response& response) {
  try {
    const auto image = boost::make_shared<sensor_msgs::Image>(request.image);
    const cv::Mat grey = greyImage(image);
    const TargetFrame& frame = finder_.findAlone(grey);
    response.detections = *toMessage(image->header, frame, config_.frame_prefix);
    const bool has_info = request.camera_info.width > 0;
    addPoses(frame, grey.size(), has_info ? &request.camera_info : nullptr, "the request", pixels_,
             pose_, response.detections);
    response.success = true;
  } catch (const std::exception& error) {
    response.message = error.what();
  }
  return true;
}

void TargetsNodelet::tick() {
  bool subscribed = false;
  std::uint32_t publishers = 0;
  {
    const std::lock_guard<std::mutex> lock(connect_mutex_);
    subscribed = subscribed_;
    if (subscribed) publishers = image_sub_.getNumPublishers();
  }
  clockStands();
  watch(*image_watch_, subscribed, monitor_.images(), publishers);
  monitor_.setListening(subscribed, image_watch_->trouble());
  diagnostics_->force_update();
}

}  // namespace ktgp_orb

PLUGINLIB_EXPORT_CLASS(ktgp_orb::TargetsNodelet, nodelet::Nodelet)
