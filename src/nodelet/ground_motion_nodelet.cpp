#include <diagnostic_updater/diagnostic_updater.h>
#include <dynamic_reconfigure/server.h>
#include <ktgp_orb/Match.h>
#include <ktgp_orb/SetPose.h>
#include <std_srvs/Trigger.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_broadcaster.h>
#include <tf2_ros/transform_listener.h>
#include <pluginlib/class_list_macros.hpp>

#include <boost/make_shared.hpp>
#include <boost/thread/recursive_mutex.hpp>
#include <chrono>
#include <deque>

#include "messages/ground_readings.h"
#include "messages/pose_message.h"
#include "nodelet/callback_thread.h"
#include "nodelet/ground_monitor.h"
#include "nodelet/image_nodelet.h"

namespace ktgp_orb {

using Lock = std::lock_guard<std::mutex>;
using std_srvs::Trigger;

/// Matches, a calibration and a height in; velocity and odometry out. doc/motion.md describes
/// topics, services and parameters. Everything but the diagnostics runs in one thread.
class GroundMotionNodelet : public ImageNodelet {
 public:
  ~GroundMotionNodelet() override;

 private:
  void start() override;
  bool isWanted() const override { return outputs_.haveSubscribers() || sends_tf_; }
  void subscribe() override;
  void unsubscribe() override;
  void configure(GroundMotionConfig& config);
  void onMatch(const MatchConstPtr& match);
  void processComplete();
  void process(const MatchConstPtr& match);
  void publish(const GroundEstimate& estimate, const std_msgs::Header& image);
  void say(const std::string& problem);
  bool reset(Trigger::Request& request, Trigger::Response& response);
  bool setPose(SetPose::Request& request, SetPose::Response& response);
  void tick();

  template <typename Message, typename Callback>
  ros::Subscriber listen(const std::string& topic, std::uint32_t queue, const Callback& callback) {
    return node_.subscribe<Message>(
        topic, queue, boost::function<void(const boost::shared_ptr<const Message>&)>(callback),
        ros::VoidConstPtr(), ros::TransportHints().tcpNoDelay());
  }

  CallbackThread queue_;
  CallbackThread slow_queue_;  // diagnostics and the watch, which ask the master
  ros::NodeHandle node_;
  boost::recursive_mutex reconfigure_mutex_;
  std::unique_ptr<dynamic_reconfigure::Server<GroundMotionConfig>> server_;
  std::vector<ros::ServiceServer> services_;
  std::vector<ros::Subscriber> inputs_;
  ros::WallTimer poll_;   // while matches wait for tf or Imu
  ros::WallTimer timer_;  // of the diagnostics
  ros::Publisher twist_pub_;
  ros::Publisher odometry_pub_;
  std::unique_ptr<tf2_ros::TransformBroadcaster> broadcaster_;
  std::unique_ptr<diagnostic_updater::Updater> diagnostics_;
  std::unique_ptr<InputWatch> match_watch_;
  std::string match_topic_;

  GroundMotionConfig config_;
  std::atomic<bool> sends_tf_{false};
  tf2_ros::Buffer tf_;
  std::unique_ptr<tf2_ros::TransformListener> listener_;
  GroundReadings readings_{tf_};
  GroundMotion motion_;
  sensor_msgs::CameraInfoConstPtr info_;
  std::deque<std::pair<MatchConstPtr, ros::WallTime>> waiting_;
  std::string said_;
  GroundMonitor monitor_;
};

GroundMotionNodelet::~GroundMotionNodelet() {
  for (CallbackThread* queue : {&queue_, &slow_queue_}) queue->stop();
  timer_.stop();
  disconnect();
  outputs_.shutdown();
  services_.clear();
  server_.reset();
}

void GroundMotionNodelet::start() {
  node_ = getNodeHandle();
  node_.setCallbackQueue(&queue_.callbacks);
  ros::NodeHandle private_node = getPrivateNodeHandle();
  private_node.setCallbackQueue(&queue_.callbacks);
  match_topic_ = node_.resolveName("match");
  camera_info_topic_ = node_.resolveName("camera_info");
  match_watch_ = std::make_unique<InputWatch>(
      InputWatch::ofMessages(match_topic_, ros::message_traits::datatype<Match>(), "match"));
  broadcaster_ = std::make_unique<tf2_ros::TransformBroadcaster>();
  outputs_.open(private_node, [this] { connectionsChanged(); });
  checkParameters<GroundMotionConfig>(private_node);
  server_ = std::make_unique<dynamic_reconfigure::Server<GroundMotionConfig>>(reconfigure_mutex_,
                                                                              private_node);
  server_->setCallback(
      [this](GroundMotionConfig& config, std::uint32_t /*level*/) { configure(config); });
  connect([&] {
    twist_pub_ = outputs_.advertise<geometry_msgs::TwistWithCovarianceStamped>("twist", 10);
    odometry_pub_ = outputs_.advertise<nav_msgs::Odometry>("odometry", 10);
    services_ = {private_node.advertiseService("reset", &GroundMotionNodelet::reset, this),
                 private_node.advertiseService("set_pose", &GroundMotionNodelet::setPose, this)};
  });
  diagnostics_ = std::make_unique<diagnostic_updater::Updater>(node_, private_node, getName());
  diagnostics_->setHardwareID(match_topic_);
  diagnostics_->add("motion", &monitor_, &GroundMonitor::report);
  ros::NodeHandle slow_node = getNodeHandle();
  slow_node.setCallbackQueue(&slow_queue_.callbacks);
  timer_ = slow_node.createWallTimer(ros::WallDuration(1.0),
                                     [this](const ros::WallTimerEvent&) { tick(); });
  for (CallbackThread* queue : {&queue_, &slow_queue_}) queue->start();
  connectionsChanged();
  NODELET_INFO(
      "takes matches on %s and the calibration on %s; the height is from %s, the normal from %s",
      match_topic_.c_str(), camera_info_topic_.c_str(), readings_.heightSource().c_str(),
      readings_.normalSource().c_str());
}

/// Other sources take effect with the next frame; what is subscribed follows them.
void GroundMotionNodelet::configure(GroundMotionConfig& config) {
  try {
    requireFinite(config);
  } catch (const std::invalid_argument& error) {
    NODELET_ERROR("new parameters are refused, the old ones stay: %s", error.what());
    config = config_;
    return;
  }
  config_ = config;
  readings_.configure(config, node_.resolveName("range"), node_.resolveName("imu"));
  sends_tf_ = config.publish_tf;
  {
    const Lock lock(connect_mutex_);
    if (subscribed_) {
      unsubscribe();
      subscribe();
    }
  }
  connectionsChanged();
}

void GroundMotionNodelet::subscribe() {
  constexpr std::uint32_t kAll = 200;  // each is a link of the chain
  listener_ = std::make_unique<tf2_ros::TransformListener>(tf_, node_, false);
  inputs_ = {
      listen<Match>("match", kAll, [this](const MatchConstPtr& match) { onMatch(match); }),
      listen<sensor_msgs::CameraInfo>(
          "camera_info", 5, [this](const sensor_msgs::CameraInfoConstPtr& info) { info_ = info; })};
  if (readings_.usesRange()) {
    inputs_.push_back(listen<sensor_msgs::Range>(
        "range", kAll, [this](const sensor_msgs::RangeConstPtr& range) { readings_.add(*range); }));
  }
  if (readings_.usesImu()) {
    inputs_.push_back(listen<sensor_msgs::Imu>(
        "imu", kAll, [this](const sensor_msgs::ImuConstPtr& imu) { readings_.add(*imu); }));
  }
  poll_ = node_.createWallTimer(ros::WallDuration(0.005),
                                [this](const ros::WallTimerEvent&) { processComplete(); });
}

void GroundMotionNodelet::unsubscribe() {
  for (ros::Subscriber& input : inputs_) input.shutdown();
  inputs_.clear();
  poll_.stop();
  listener_.reset();
}

void GroundMotionNodelet::onMatch(const MatchConstPtr& match) {
  constexpr std::size_t kMost = 10;
  waiting_.emplace_back(match, ros::WallTime::now());
  while (waiting_.size() > kMost) {
    process(waiting_.front().first);
    waiting_.pop_front();
  }
  processComplete();
}

/// A match waits a little for the messages of its time that come after it.
void GroundMotionNodelet::processComplete() {
  while (!waiting_.empty()) {
    const auto& [match, arrival] = waiting_.front();
    const double waited = (ros::WallTime::now() - arrival).toSec();
    const bool ready = info_ && readings_.complete(match->header.stamp, match->header.frame_id);
    if (!ready && waited < config_.max_age) return;
    process(match);
    waiting_.pop_front();
  }
}

void GroundMotionNodelet::process(const MatchConstPtr& match) {
  const auto start = std::chrono::steady_clock::now();
  std::string problem;
  try {
    if (!info_) throw std::invalid_argument("no camera_info on " + camera_info_topic_);
    const Pixels pixels = pixelsFrom(config_.calibration, node_.resolveName("image"));
    const cv::Size size(static_cast<int>(match->correspondences.image_width),
                        static_cast<int>(match->correspondences.image_height));
    motion_.setOptions(readings_.optionsFor(match->header));
    const GroundEstimate& estimate =
        motion_.add(readings_.frameOf(match->homography, size, *info_, pixels));
    problem = monitor_.problemOf(estimate, readings_, match->header.stamp, config_.patience);
    if (problem.empty()) publish(estimate, match->header);
    if (problem.empty() && estimate.status == GroundStatus::resumed) {
      NODELET_WARN("the odometry goes on after %.2f s without connection, with a larger covariance",
                   estimate.gap);
    }
    monitor_.setEstimate(estimate, match->homography.plane_deviation);
  } catch (const std::invalid_argument& error) {
    problem = error.what();
  }
  say(problem);
  monitor_.done(problem, std::chrono::steady_clock::now() - start);
}

/// In the diagnostics as long as it lasts; in the log once.
void GroundMotionNodelet::say(const std::string& problem) {
  const std::string kind = problem.substr(0, problem.find_first_of("0123456789"));
  if (!problem.empty() && kind != said_) NODELET_WARN("nothing is published: %s", problem.c_str());
  said_ = kind;
}

void GroundMotionNodelet::publish(const GroundEstimate& estimate, const std_msgs::Header& image) {
  const auto odometry =
      boost::make_shared<nav_msgs::Odometry>(odometryOf(estimate, image, config_));
  odometry_pub_.publish(odometry);
  if (estimate.hasTwist()) {
    twist_pub_.publish(boost::make_shared<geometry_msgs::TwistWithCovarianceStamped>(
        twistOf(estimate, image, config_)));
  }
  if (!config_.publish_tf) return;
  broadcaster_->sendTransform(
      transformOf(odometry->header, odometry->child_frame_id, odometry->pose.pose));
}

bool GroundMotionNodelet::reset(Trigger::Request& /*request*/, Trigger::Response& response) {
  motion_.reset();
  response.success = true;
  response.message = "the odometry begins anew with the next frame";
  return true;
}

bool GroundMotionNodelet::setPose(SetPose::Request& request, SetPose::Response& response) {
  try {
    motion_.setPose(poseOf(request.pose.pose), covarianceOf(request.pose));
    response.success = true;
  } catch (const std::invalid_argument& error) {
    response.message = error.what();
  }
  return true;
}

void GroundMotionNodelet::tick() {
  const bool subscribed = isSubscribed();
  clockStands();
  watch(*match_watch_, subscribed, monitor_.matches(), 0);
  monitor_.setListening(subscribed, match_topic_, match_watch_->trouble());
  diagnostics_->force_update();
}

}  // namespace ktgp_orb

PLUGINLIB_EXPORT_CLASS(ktgp_orb::GroundMotionNodelet, nodelet::Nodelet)
