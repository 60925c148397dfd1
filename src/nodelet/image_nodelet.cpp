#include "nodelet/image_nodelet.h"

#include <image_transport/camera_common.h>

#include <algorithm>
#include <exception>

#include "nodelet/image_input.h"

namespace ktgp_orb {
namespace {

// ROS_*_THROTTLE does not fit: it is shared by all nodelets of a process, and silent while ROS time
// is zero.
constexpr std::chrono::seconds kRepeatRefusal{5};

using Lock = std::lock_guard<std::mutex>;

}  // namespace

void ImageNodelet::onInit() {
  try {
    start();
  } catch (const std::exception& error) {
    NODELET_FATAL("%s", error.what());  // the loader catches the exception without a message
    throw;
  }
}

void ImageNodelet::openInput(const ros::NodeHandle& node, const ros::NodeHandle& private_node,
                             int queue_size) {
  const ImageInput input =
      imageInput(node, private_node.param<std::string>("image_transport", "raw"));
  // Its last argument is the parameter that would choose another plugin.
  transport_hints_ = std::make_unique<image_transport::TransportHints>(
      input.plugin, ros::TransportHints(), private_node, "image_transport_plugin");
  queue_size_ =
      static_cast<std::uint32_t>(std::max(1, private_node.param("queue_size", queue_size)));
  image_topic_ = input.topic;
  camera_info_topic_ = image_transport::getCameraInfoTopic(image_topic_);
  image_watch_ = std::make_unique<InputWatch>(image_topic_, input.transport);
}

void ImageNodelet::connectionsChanged() {
  const Lock lock(connect_mutex_);
  if (!connected_ || isWanted() == subscribed_) return;
  subscribed_ = !subscribed_;
  if (subscribed_) {
    subscribe();
  } else {
    unsubscribe();
  }
}

void ImageNodelet::connect(const std::function<void()>& advertise) {
  const Lock lock(connect_mutex_);
  advertise();
  connected_ = true;
}

void ImageNodelet::disconnect() {
  const Lock lock(connect_mutex_);
  connected_ = false;
  if (subscribed_) unsubscribe();
  subscribed_ = false;
}

bool ImageNodelet::isSubscribed() {
  const Lock lock(connect_mutex_);
  return subscribed_;
}

void ImageNodelet::sayUnknown(const std::vector<std::string>& parameters) {
  for (const std::string& name : parameters) {
    NODELET_WARN("parameter %s is not known to this node and has no effect", name.c_str());
  }
}

void ImageNodelet::sayRefused(const std::string& reason) {
  const auto now = std::chrono::steady_clock::now();
  if (now - last_refusal_ < kRepeatRefusal) return;
  last_refusal_ = now;
  NODELET_ERROR("image on %s is refused: %s", image_topic_.c_str(), reason.c_str());
}

bool ImageNodelet::clockStands() {
  const ros::Time now = ros::Time::now();
  clock_stands_ = ros::Time::isSimTime() && now == last_time_;
  last_time_ = now;
  return clock_stands_;
}

void ImageNodelet::watch(InputWatch& watch, bool subscribed, std::uint64_t arrived,
                         std::uint32_t publishers) {
  // A paused bag is not a broken camera, nor is one that bag.launch has not yet begun to play (it
  // sets this parameter); any other clock that never started is an error.
  if (clock_stands_ && (!clockIsMissing() || ros::param::has("/ktgp_orb_plays_a_bag"))) return;
  const std::string warning = watch.tick(subscribed, arrived, publishers);
  if (!warning.empty()) NODELET_WARN("%s", warning.c_str());
}

std::string ImageNodelet::watchMixture(std::uint32_t publishers) {
  std::string mixture = image_watch_->mixture(publishers);
  if (!mixture.empty() && !said_mixture_) NODELET_WARN("%s", mixture.c_str());
  said_mixture_ = !mixture.empty();
  return mixture;
}

}  // namespace ktgp_orb
