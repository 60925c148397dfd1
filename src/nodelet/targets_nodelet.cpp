#include <image_transport/camera_common.h>
#include <ktgp_orb/DetectTargets.h>
#include <ktgp_orb/RemoveTarget.h>
#include <ktgp_orb/SetTarget.h>
#include <ktgp_orb/TargetsConfig.h>
#include <tf2_ros/transform_broadcaster.h>
#include <pluginlib/class_list_macros.hpp>

#include <algorithm>
#include <atomic>
#include <boost/make_shared.hpp>
#include <functional>
#include <memory>
#include <utility>

#include "ktgp_orb/overlay.h"
#include "nodelet/image_node.h"
#include "nodelet/target_book.h"
#include "ros/image_conversion.h"
#include "ros/message_conversion.h"
#include "ros/target_messages.h"
#include "util/camera_check.h"

namespace ktgp_orb {

/// Finds the known targets in images, follows them, and publishes the detections.
class TargetsWork {
 public:
  TargetsWork(Diagnosis& diagnosis, const ros::Publisher& detections, const ros::Publisher& markers,
              image_transport::Publisher pictures, std::string image_topic, std::string info_topic)
      : diagnosis_(diagnosis),
        detections_(detections),
        markers_(markers),
        pictures_(std::move(pictures)),
        image_topic_(std::move(image_topic)),
        info_topic_(std::move(info_topic)) {}

  void configure(const TargetsConfig& config);
  void addCameraInfo(const sensor_msgs::CameraInfoConstPtr& info) { info_ = info; }
  void search(const sensor_msgs::ImageConstPtr& image);
  void restart();

  TargetFinder& finder() { return finder_; }
  void change(const std::function<void(TargetFinder&)>& act);
  const TargetsConfig& config() const { return config_; }
  Pixels pixels() const { return pixelsFrom(config_.calibration, image_topic_); }

 private:
  void report(const TargetDetections& message);
  void sendTransforms(const TargetDetections& message);
  void publish(const TargetDetectionsPtr& message, const sensor_msgs::ImageConstPtr& image,
               const TargetFrame& frame);

  TargetsConfig config_;
  TargetFinder finder_;
  TargetPose pose_;
  sensor_msgs::CameraInfoConstPtr info_;
  ImageSequence sequence_;
  Diagnosis& diagnosis_;
  ros::Publisher detections_;
  ros::Publisher markers_;
  image_transport::Publisher pictures_;
  const std::string image_topic_;
  const std::string info_topic_;
  tf2_ros::TransformBroadcaster broadcaster_;
};

void TargetsWork::configure(const TargetsConfig& config) {
  config_ = config;
  sequence_.searchAnew();
  finder_.setSearch(config.search_ms, config.smallest_side, config.max_instances);
  pose_.setReadoutTime(config.readout_time);
}

void TargetsWork::change(const std::function<void(TargetFinder&)>& act) {
  sequence_.searchAnew();
  act(finder_);
}

void TargetsWork::restart() {
  info_.reset();
  sequence_ = {};
  finder_.restart();
}

void TargetsWork::search(const sensor_msgs::ImageConstPtr& image) {
  const auto start = Diagnosis::Clock::now();
  const cv::Mat grey = greyImage(image);
  if (!sequence_.next(image, grey, finder_)) {
    diagnosis_.count(Diagnosis::kRepeated);
    return;
  }
  const TargetFrame& frame = finder_.find(grey);
  const TargetDetectionsPtr message = toMessage(image->header, frame, config_.frame_prefix);
  addPoses(frame, grey.size(), info_.get(), info_topic_, pixels(), pose_, *message);
  report(*message);
  publish(message, image, frame);
  diagnosis_.done(image->header.stamp, start);
}

void TargetsWork::report(const TargetDetections& message) {
  const auto lacks_pose = [](const TargetDetection& target) {
    return wantsPose(target) && target.has_pose == 0;
  };
  const auto& found = message.detections;
  const bool lacks_one = std::any_of(found.begin(), found.end(), lacks_pose);
  diagnosis_.setProblem("pose", lacks_one ? "a target has no pose: " + message.no_pose : "");
  std::string ambiguous;
  for (const TargetDetection& target : message.detections) {
    if (target.ambiguity.empty()) continue;
    ambiguous = target.id + " looks the same " + target.ambiguity + ": its pose is one of several";
  }
  diagnosis_.setProblem("ambiguous", ambiguous, false);
  diagnosis_.setProblem("limit",
                        message.at_limit.empty() ? ""
                                                 : "max_instances of " + message.at_limit +
                                                       " were found; there may be more",
                        false);
  diagnosis_.setProblem("known", message.known == 0 ? "no target is known" : "", false);
  diagnosis_.count("found", message.detections.size());
  diagnosis_.setValue("known targets", std::to_string(message.known));
  diagnosis_.setValue("candidates", std::to_string(message.candidates));
  diagnosis_.setValue("tried", std::to_string(message.tried));
  diagnosis_.setValue("frames for all", std::to_string(message.frames_for_all));
}

void TargetsWork::sendTransforms(const TargetDetections& message) {
  std::string problem;
  try {
    if (config_.publish_tf) broadcaster_.sendTransform(transformsOf(message));
  } catch (const std::invalid_argument& error) {
    problem = error.what();
  }
  diagnosis_.setProblem("tf", problem);
}

void TargetsWork::publish(const TargetDetectionsPtr& message,
                          const sensor_msgs::ImageConstPtr& image, const TargetFrame& frame) {
  detections_.publish(message);
  if (markers_.getNumSubscribers() > 0) markers_.publish(markersOf(*message));
  sendTransforms(*message);
  if (pictures_.getNumSubscribers() == 0) return;
  cv::Mat canvas;
  drawTargets(colourImage(image), frame.detections, canvas);
  pictures_.publish(toImage(message->header, "bgr8", canvas));
}

/// Finds flat targets in images. doc/targets.md describes topics, services and parameters.
///
/// Only callbacks in long_queue_ use the TargetBook, read and write files, and convert the images
/// of requests. Between two images, the worker adds a target or searches the image of a request.
class TargetsNodelet : public ImageNode<TargetsConfig, TargetsWork> {
 public:
  ~TargetsNodelet() override { stop(); }

 private:
  void start() override;
  void advertise() override;
  std::string nodelet() const override { return "targets"; }
  std::string workName() const override { return "targets"; }
  std::string greeting() const override;
  bool isWanted() const override {
    return outputs_.haveSubscribers() || (publishes_tf_ && has_frames_);
  }
  void listeningChanged(bool listening) override;
  void configure(TargetsConfig& config) override;

  template <typename Service, typename Change>
  void addChange(const std::string& name, const Change& change);
  void loadNext();
  void targetsChanged();
  void detect(DetectTargets::Request& request, DetectTargets::Response& response);
  std::string sayAmbiguity(const std::string& id);

  static constexpr std::size_t kImage = 1;  // kinds of jobs of the worker
  static constexpr std::size_t kCameraInfo = 2;

  ImageInput* images_ = nullptr;
  Input* camera_info_ = nullptr;
  TargetBook book_{[this](const auto& use) {  // after start(), only callbacks in long_queue_ use it
    worker_.ask([&](TargetsWork& work) { work.change(use); });
  }};
  ros::WallTimer load_;
  std::atomic<bool> publishes_tf_{false};
  std::atomic<bool> has_frames_{false};
};

void TargetsNodelet::start() {
  images_ = &addImages(1, [this](const sensor_msgs::ImageConstPtr& image, std::uint32_t /*lost*/) {
    diagnosis_.count(Diagnosis::kDropped, worker_.put<&TargetsWork::search>(kImage, 0, image));
  });
  camera_info_ = &addInput<sensor_msgs::CameraInfo>(
      image_transport::getCameraInfoTopic(images_->topic()), "camera_info", 1, false,
      [this](const sensor_msgs::CameraInfoConstPtr& info) {
        worker_.put<&TargetsWork::addCameraInfo>(kCameraInfo, 0, info);
      });
  worker_.setLimits(kImage, 1);
  worker_.setLimits(kCameraInfo, 1);
  serveParameters();
  book_.open(config_.targets, config_.file);
}

std::string TargetsNodelet::greeting() const {
  return "searches targets in images on " + images_->topic() + " (transport " +
         images_->transport() + "), calibration on " + camera_info_->topic() +
         (book_.file().empty() ? "" : ", keeps targets in " + util::printable(book_.file(), 600));
}

void TargetsNodelet::advertise() {
  const auto detections = outputs_.advertise<TargetDetections>("detections", 10);
  const auto markers = outputs_.advertise<visualization_msgs::MarkerArray>("markers", 2);
  const auto pictures = outputs_.advertiseImage("image", 2);
  addChange<SetTarget>("add", [this](auto& request) {
    book_.add(request);
    return sayAmbiguity(request.id);
  });
  addChange<SetTarget>("replace", [this](auto& request) {
    book_.replace(request);
    return sayAmbiguity(request.id);
  });
  addChange<RemoveTarget>("remove", [this](auto& request) {
    book_.remove(request.id);
    return std::string();
  });
  addService<DetectTargets>("detect", long_queue_,
                            [this](auto& request, auto& response) { detect(request, response); });
  // Targets are loaded one by one, so that the nodelet can be unloaded at any time.
  load_ = addTimer(long_queue_, 0.001, [this] { loadNext(); });
  startWorker(std::make_unique<TargetsWork>(diagnosis_, detections, markers, pictures,
                                            images_->topic(), camera_info_->topic()));
}

template <typename Service, typename Change>
void TargetsNodelet::addChange(const std::string& name, const Change& change) {
  addService<Service>(name, long_queue_, [this, change](auto& request, auto& response) {
    response.message = change(request);
    targetsChanged();
  });
}

/// Returns and logs a warning if the new target looks the same in another pose. Otherwise returns
/// an empty text.
std::string TargetsNodelet::sayAmbiguity(const std::string& id) {
  std::string text = worker_.ask([&](TargetsWork& work) { return work.finder().ambiguity(id); });
  if (text.empty()) return text;
  text = "target " + util::quoted(id) + " looks the same " + text +
         ": its pose is one of several, and is not sent to tf";
  NODELET_WARN("%s", text.c_str());
  return text;
}

void TargetsNodelet::configure(TargetsConfig& config) {
  util::requireReadoutTime(config.readout_time);
  worker_.post([config](TargetsWork& work) { work.configure(config); });
  publishes_tf_ = config.publish_tf;
  connectionsChanged();
}

void TargetsNodelet::listeningChanged(bool listening) {
  if (listening) return;
  worker_.clear(kImage);
  worker_.post([](TargetsWork& work) { work.restart(); });
}

void TargetsNodelet::loadNext() {
  if (!book_.isLoading()) {
    load_.stop();
    const std::size_t known =
        worker_.ask([](TargetsWork& work) { return work.finder().ids().size(); });
    NODELET_INFO(
        "known targets: %zu%s", known,
        known == 0 ? "; set `targets` to a folder or a list, or add them by the services" : "");
    return;
  }
  book_.loadNext();
  diagnosis_.setValue("targets not read yet", std::to_string(book_.waiting()));
  targetsChanged();
}

/// We cannot know whether anyone listens to tf, so we search the images as long as a target has a
/// tf frame.
void TargetsNodelet::targetsChanged() {
  diagnosis_.setFault("targets", book_.refusal());
  has_frames_ = book_.hasFrames();
  connectionsChanged();
}

void TargetsNodelet::detect(DetectTargets::Request& request, DetectTargets::Response& response) {
  requireSmall("the image", request.image);
  const auto image = boost::make_shared<sensor_msgs::Image>(request.image);
  const cv::Mat grey = greyImage(image);
  std::string frame_prefix;
  Pixels pixels = Pixels::raw;
  const TargetFrame frame = worker_.ask([&](TargetsWork& work) {
    frame_prefix = work.config().frame_prefix;
    pixels = work.pixels();
    return work.finder().findAlone(grey);
  });
  TargetPose pose;
  response.detections = *toMessage(image->header, frame, frame_prefix);
  const bool has_info = request.camera_info.width > 0;
  addPoses(frame, grey.size(), has_info ? &request.camera_info : nullptr, "the request", pixels,
           pose, response.detections);
}

}  // namespace ktgp_orb

PLUGINLIB_EXPORT_CLASS(ktgp_orb::TargetsNodelet, nodelet::Nodelet)
