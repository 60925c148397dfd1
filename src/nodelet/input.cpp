#include "nodelet/input.h"

#include <algorithm>
#include <stdexcept>

namespace ktgp_orb {
namespace {

void requireTransport(const image_transport::ImageTransport& node, const std::string& transport) {
  const auto names = node.getLoadableTransports();
  if (std::find(names.begin(), names.end(), "image_transport/" + transport) != names.end()) return;
  throw std::invalid_argument("image transport '" + transport + "' is not installed; the package " +
                              transport +
                              "_image_transport provides it (on ROS Noetic: apt install "
                              "ros-noetic-" +
                              transport + "-image-transport)");
}

}  // namespace

void Input::subscribe(bool wanted) {
  wanted = wanted && enabled_;
  if (wanted == subscribed_) return;
  subscribed_ = wanted;
  if (wanted) {
    open();
  } else {
    close();
  }
}

bool Input::isNew(const boost::shared_ptr<const void>& message) {
  if (last_.lock() == message) return false;
  last_ = message;
  ++arrived_;
  return true;
}

ImageInput::ImageInput(const ros::NodeHandle& node, const ros::NodeHandle& private_node,
                       int queue_size, Callback callback)
    : Input(node.resolveName("image"), "image"),
      transport_(node),
      hints_("raw", ros::TransportHints(), private_node),
      transport_name_(hints_.getTransport()),
      queue_size_(
          static_cast<std::uint32_t>(std::max(1, private_node.param("queue_size", queue_size)))),
      callback_(std::move(callback)) {
  requireTransport(transport_, transport_name_);
  watch_ = std::make_unique<InputWatch>(topic_, transport_name_);
}

void ImageInput::open() {
  is_new_subscription_ = true;
  subscriber_ = transport_.subscribe(
      topic_, queue_size_,
      [this](const sensor_msgs::ImageConstPtr& image) {
        if (isNew(image)) callback_(image, lostBefore(*image));
      },
      ros::VoidPtr(), hints_);
}

// Two publishers of one topic have separate counters, so gaps mean nothing.
std::uint32_t ImageInput::lostBefore(const sensor_msgs::Image& image) {
  if (is_new_subscription_.exchange(false) || known_publishers_ > 1) numbers_.restart();
  return numbers_.lostBefore(image.header.seq);
}

}  // namespace ktgp_orb
