#include "nodelet/input.h"

#include <algorithm>
#include <stdexcept>

namespace ktgp_orb {
namespace {

const std::string kCompressedTransport = "compressed";
const std::string kOwnPlugin = "ktgp_compressed";  // see compressed_subscriber.cpp

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

std::string ImageInput::choosePlugin() {
  const std::string suffix = "/" + kCompressedTransport;
  const std::size_t stem = topic_.size() - std::min(topic_.size(), suffix.size());
  const bool named = topic_.compare(stem, std::string::npos, suffix) == 0;
  if (named && (transport_name_ == "raw" || transport_name_ == kCompressedTransport)) {
    topic_.erase(stem);
    transport_name_ = kCompressedTransport;
  }
  const auto installed = transport_.getLoadableTransports();
  const auto is_installed = [&installed](const std::string& plugin) {
    return std::find(installed.begin(), installed.end(), "image_transport/" + plugin) !=
           installed.end();
  };
  // Prefer our own plugin: it refuses images that are cut off, and it refuses images that are too
  // large before it decodes them.
  if (transport_name_ == kCompressedTransport && is_installed(kOwnPlugin)) return kOwnPlugin;
  if (is_installed(transport_name_)) return transport_name_;
  if (transport_name_ != kCompressedTransport) {
    throw std::invalid_argument("image transport '" + transport_name_ +
                                "' is not installed; the package " + transport_name_ +
                                "_image_transport provides it (on ROS Noetic: apt install "
                                "ros-noetic-" +
                                transport_name_ + "-image-transport)");
  }
  throw std::invalid_argument(
      "compressed images cannot be decoded: the library ktgp_orb_compressed of this package is not "
      "found; build the whole package, and source its setup.bash");
}

ImageInput::ImageInput(const ros::NodeHandle& node, const ros::NodeHandle& private_node,
                       int queue_size, Callback callback)
    : Input(node.resolveName("image"), "image"),
      transport_(node),
      transport_name_(private_node.param<std::string>("image_transport", "raw")),
      // The last argument is the parameter with which users can choose another plugin.
      hints_(choosePlugin(), ros::TransportHints(), private_node, "image_transport_plugin"),
      queue_size_(
          static_cast<std::uint32_t>(std::max(1, private_node.param("queue_size", queue_size)))),
      callback_(std::move(callback)) {
  watch_ = std::make_unique<InputWatch>(topic_, ros::message_traits::datatype<sensor_msgs::Image>(),
                                        what_, transport_name_);
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

// Each publisher of a topic has its own counter, so if there are several publishers, a gap between
// two numbers does not mean that an image is lost.
std::uint32_t ImageInput::lostBefore(const sensor_msgs::Image& image) {
  if (is_new_subscription_.exchange(false) || known_publishers_ > 1) numbers_.restart();
  return numbers_.lostBefore(image.header.seq);
}

}  // namespace ktgp_orb
