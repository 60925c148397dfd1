#include <geometry_msgs/TwistWithCovarianceStamped.h>
#include <ktgp_orb/Match.h>
#include <ktgp_orb/MatchStatus.h>
#include <ktgp_orb/SetPose.h>
#include <nav_msgs/Odometry.h>
#include <std_srvs/Trigger.h>
#include <tf2_ros/buffer.h>
#include <tf2_ros/transform_broadcaster.h>
#include <tf2_ros/transform_listener.h>
#include <pluginlib/class_list_macros.hpp>

#include <atomic>
#include <boost/make_shared.hpp>
#include <deque>
#include <memory>
#include <string>
#include <utility>

#include "nodelet/image_node.h"
#include "ros/ground_readings.h"
#include "ros/pose_message.h"
#include "util/format.h"

namespace ktgp_orb {
namespace {

using std_srvs::Trigger;

constexpr const char* kNoTime =
    "header.stamp of the images is zero, so there is no time between them; the driver should give "
    "each image the time of its exposure";

/// Said in the diagnostics alone, as it is so at each start.
constexpr const char* kStart = "the first frame has no reference";

std::string number(double value) {
  return util::format("%.6g", value);
}

}  // namespace

/// The worker's part of the nodelet: estimates the motion. Each match waits here until the
/// camera_info and the readings of tf and the Imu for the time of its image have arrived.
class GroundWork {
 public:
  /// `names`: node handle that resolves the names of the topics.
  GroundWork(const ros::NodeHandle& names, const tf2::BufferCore& tf, Diagnosis& diagnosis,
             const ros::Publisher& twists, const ros::Publisher& odometry,
             std::atomic<bool>& is_waiting)
      : image_topic_(names.resolveName("image")),
        camera_info_topic_(names.resolveName("camera_info")),
        range_topic_(names.resolveName("range")),
        imu_topic_(names.resolveName("imu")),
        readings_(tf),
        diagnosis_(diagnosis),
        twists_(twists),
        odometry_(odometry),
        is_waiting_(is_waiting) {}

  void configure(const GroundMotionConfig& config);
  void addMatch(const MatchConstPtr& match);
  void addRange(const sensor_msgs::RangeConstPtr& range) { readings_.add(*range); }
  void addImu(const sensor_msgs::ImuConstPtr& imu) { readings_.add(*imu); }
  void addCameraInfo(const sensor_msgs::CameraInfoConstPtr& info) { info_ = info; }
  void processComplete();
  void reset() { motion_.reset(); }
  void setPose(const Pose3& pose, const Covariance6& covariance) {
    motion_.setPose(pose, covariance);
  }

 private:
  void process(const MatchConstPtr& match);
  void report(const GroundEstimate& estimate, double plane_deviation);
  void publish(const GroundEstimate& estimate, const std_msgs::Header& image);

  const std::string image_topic_;
  const std::string camera_info_topic_;
  const std::string range_topic_;
  const std::string imu_topic_;
  GroundMotionConfig config_;
  GroundReadings readings_;
  GroundMotion motion_;
  sensor_msgs::CameraInfoConstPtr info_;
  std::deque<std::pair<MatchConstPtr, ros::WallTime>> waiting_;
  Diagnosis& diagnosis_;
  ros::Publisher twists_;
  ros::Publisher odometry_;
  tf2_ros::TransformBroadcaster broadcaster_;
  std::atomic<bool>& is_waiting_;
};

/// New sources of height and normal take effect with the next frame.
void GroundWork::configure(const GroundMotionConfig& config) {
  config_ = config;
  readings_.configure(config, range_topic_, imu_topic_);
  diagnosis_.setValue("sources", "height from " + readings_.heightSource() + ", normal from " +
                                     readings_.normalSource());
}

void GroundWork::addMatch(const MatchConstPtr& match) {
  constexpr std::size_t kMost = 100;  // 0.8 s at 120 images a second
  waiting_.emplace_back(match, ros::WallTime::now());
  while (waiting_.size() > kMost) {
    process(waiting_.front().first);
    waiting_.pop_front();
  }
}

/// Processes the waiting matches in order. A match waits for late readings, but for at most max_age
/// seconds.
void GroundWork::processComplete() {
  while (!waiting_.empty()) {
    const auto& [match, arrival] = waiting_.front();
    const double waited = (ros::WallTime::now() - arrival).toSec();
    const bool ready = info_ && readings_.complete(match->header);
    if (!ready && waited < config_.max_age) break;
    process(match);
    waiting_.pop_front();
  }
  is_waiting_ = !waiting_.empty();
}

void GroundWork::process(const MatchConstPtr& match) {
  const auto start = Diagnosis::Clock::now();
  std::string problem;
  try {
    if (!info_) throw std::invalid_argument("no camera_info on " + camera_info_topic_);
    if (match->header.stamp.isZero()) throw std::invalid_argument(kNoTime);
    const Pixels pixels = pixelsFrom(config_.calibration, image_topic_);
    const cv::Size size(static_cast<int>(match->homography.image_width),
                        static_cast<int>(match->homography.image_height));
    motion_.setOptions(readings_.optionsFor(match->header));
    const GroundEstimate estimate = readings_.withPatience(
        motion_.add(readings_.frameOf(match->homography, size, *info_, pixels)));
    const bool is_start = estimate.status == GroundStatus::no_homography &&
                          match->homography.reason == MatchStatus::REASON_FIRST_FRAME;
    problem = is_start ? kStart : readings_.problemOf(estimate);
    const std::string not_used = readings_.notUsed(estimate);
    diagnosis_.setProblem("not used", not_used, false);
    diagnosis_.setValue("not used", util::printable(not_used, 600));
    if (problem.empty()) publish(estimate, match->header);
    report(estimate, match->homography.plane_deviation);
  } catch (const std::invalid_argument& error) {
    problem = error.what();
  }
  if (!problem.empty()) diagnosis_.setProblem("not used", "");
  diagnosis_.setProblem("motion", problem.empty() ? "" : "nothing is published: " + problem,
                        problem != kStart);
  diagnosis_.count("published", problem.empty() ? 1 : 0);
  diagnosis_.done(match->header.stamp, start);
}

void GroundWork::report(const GroundEstimate& estimate, double plane_deviation) {
  diagnosis_.setProblem("gap", estimate.status == GroundStatus::resumed
                                   ? "the odometry goes on after " + number(estimate.gap) +
                                         " s without connection, with a larger covariance"
                                   : "");
  diagnosis_.setValue("status", toString(estimate.status));
  diagnosis_.setValue("height (m)", number(estimate.height));
  diagnosis_.setValue("normal, deviation (rad)", number(estimate.tilt_deviation));
  diagnosis_.setValue("height, deviations off", number(estimate.height_misfit));
  diagnosis_.setValue("normal, deviations off", number(estimate.down_misfit));
  diagnosis_.setValue("rotation, deviations off", number(estimate.turn_misfit));
  diagnosis_.setValue("homography, deviations off", number(estimate.homography_misfit));
  diagnosis_.setValue("shutter, as the pictures show it", shutterReport(estimate));
  diagnosis_.setProblem("shutter", shutterTrouble(estimate, config_.readout_time));
  diagnosis_.setValue("readout time of the shutter (s)", number(estimate.readout_time));
  diagnosis_.setValue("readout time, deviation (s)", number(estimate.readout_deviation));
  diagnosis_.setValue("Imu, as the pictures show it", estimate.imu ? describe(*estimate.imu) : "");
  diagnosis_.setProblem("Imu", estimate.imu ? troubleOf(*estimate.imu) : "");
  diagnosis_.setValue("deviation from a plane (px)", number(plane_deviation));
  if (estimate.gap > 0.0) diagnosis_.setValue("last gap (s)", number(estimate.gap));
}

void GroundWork::publish(const GroundEstimate& estimate, const std_msgs::Header& image) {
  const std::string base = baseFrame(image, config_);
  if (estimate.hasTwist() && twists_.getNumSubscribers() > 0) {
    const auto twist = boost::make_shared<geometry_msgs::TwistWithCovarianceStamped>();
    twist->header = image;
    twist->header.frame_id = base;
    twist->twist = toMessage(estimate.twist, estimate.twist_covariance);
    twists_.publish(twist);
  }
  if (odometry_.getNumSubscribers() == 0 && !config_.publish_tf) return;
  const Covariance6 not_known = 1e6 * Covariance6::Identity();
  const auto odometry = boost::make_shared<nav_msgs::Odometry>();
  odometry->header = image;
  odometry->header.frame_id = config_.odom_frame;
  odometry->child_frame_id = base;
  odometry->pose = toMessage(estimate.base_to_odometry, estimate.pose_covariance);
  odometry->twist =
      toMessage(estimate.twist, estimate.hasTwist() ? estimate.twist_covariance : not_known);
  odometry_.publish(odometry);
  if (!config_.publish_tf) return;
  broadcaster_.sendTransform(
      transformOf(odometry->header, odometry->child_frame_id, odometry->pose.pose));
}

/// Computes velocity and odometry from matches, a calibration and a height. doc/motion.md describes
/// topics, services and parameters.
class GroundMotionNodelet : public ImageNode<GroundMotionConfig, GroundWork> {
 public:
  ~GroundMotionNodelet() override {
    stop();
    listener_.reset();
  }

 private:
  void start() override;
  void advertise() override;
  std::string nodelet() const override { return "ground_motion"; }
  std::string workName() const override { return "motion"; }
  std::string greeting() const override;
  bool isWanted() const override { return outputs_.haveSubscribers() || sends_tf_; }
  void listeningChanged(bool listening) override;
  void configure(GroundMotionConfig& config) override;

  /// Adds an input. Up to `most` of its messages may wait for the worker; older messages are
  /// dropped. The diagnostics count dropped matches, but not other dropped messages, because only a
  /// lost match breaks the chain from frame to frame.
  template <auto Use, typename Message>
  Input& addReadings(const std::string& name, std::size_t kind, std::size_t most) {
    worker_.setLimits(kind, most);
    return addInput<Message>(name, name, 200, kind == kMatch,
                             [this, kind](const boost::shared_ptr<const Message>& message) {
                               if (kind == kMatch) diagnosis_.arrived();
                               const std::size_t dropped = worker_.put<Use>(kind, 0, message);
                               if (kind == kMatch) diagnosis_.count(Diagnosis::kDropped, dropped);
                             });
  }

  static constexpr std::size_t kMatch = 1;  // kinds of jobs of the worker
  static constexpr std::size_t kCameraInfo = 2;
  static constexpr std::size_t kRange = 3;
  static constexpr std::size_t kImu = 4;

  Input* matches_ = nullptr;
  Input* ranges_ = nullptr;
  Input* imus_ = nullptr;
  std::atomic<bool> sends_tf_{false};
  ros::WallTimer poll_;
  std::atomic<bool> is_waiting_{false};  // whether a match waits for tf or the Imu
  tf2_ros::Buffer tf_;                   // has its own lock, so any thread may use it
  std::unique_ptr<tf2_ros::TransformListener> listener_;
};

void GroundMotionNodelet::start() {
  matches_ = &addReadings<&GroundWork::addMatch, Match>("match", kMatch, 200);
  addReadings<&GroundWork::addCameraInfo, sensor_msgs::CameraInfo>("camera_info", kCameraInfo, 1);
  ranges_ = &addReadings<&GroundWork::addRange, sensor_msgs::Range>("range", kRange, 1000);
  imus_ = &addReadings<&GroundWork::addImu, sensor_msgs::Imu>("imu", kImu, 1000);
  serveParameters();
}

std::string GroundMotionNodelet::greeting() const {
  return "takes matches on " + matches_->topic() + "; the height is from " + config_.height_source +
         ", the normal from " + config_.normal_source;
}

void GroundMotionNodelet::configure(GroundMotionConfig& config) {
  config = usable(config);
  worker_.post([config](GroundWork& work) { work.configure(config); });
  ranges_->enable(config.height_source == "range");
  imus_->enable(config.normal_source == "imu" || config.gyro);
  sends_tf_ = config.publish_tf;
  connectionsChanged();
}

void GroundMotionNodelet::advertise() {
  const auto twists = outputs_.advertise<geometry_msgs::TwistWithCovarianceStamped>("twist", 10);
  const auto odometry = outputs_.advertise<nav_msgs::Odometry>("odometry", 10);
  addService<Trigger>("reset", service_queue_, [this](auto& /*request*/, auto& response) {
    worker_.ask([](GroundWork& work) { work.reset(); });
    response.message = "the odometry begins anew with the next frame";
  });
  addService<SetPose>("set_pose", service_queue_, [this](auto& request, auto& /*response*/) {
    const Pose3 pose = poseOf(request.pose.pose);
    const Covariance6 covariance = covarianceOf(request.pose);
    worker_.ask([&](GroundWork& work) { work.setPose(pose, covariance); });
  });
  // Poll while a match waits, because new tf data do not wake the worker.
  poll_ = addTimer(data_queue_, 0.005, [this] {
    if (is_waiting_.exchange(false)) worker_.post([](GroundWork&) {});
  });
  poll_.stop();
  // Also while nothing subscribes to our results: a bag sends /tf_static once, and without
  // latching.
  listener_ = std::make_unique<tf2_ros::TransformListener>(tf_, node(data_queue_), false);
  startWorker(
      std::make_unique<GroundWork>(getNodeHandle(), tf_, diagnosis_, twists, odometry, is_waiting_),
      [](GroundWork& work) { work.processComplete(); });
}

void GroundMotionNodelet::listeningChanged(bool listening) {
  if (listening) {
    poll_.start();
  } else {
    poll_.stop();
  }
}

}  // namespace ktgp_orb

PLUGINLIB_EXPORT_CLASS(ktgp_orb::GroundMotionNodelet, nodelet::Nodelet)
