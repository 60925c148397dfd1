#include "nodelet/image_input.h"

#include <image_transport/image_transport.h>

#include <algorithm>
#include <stdexcept>

namespace ktgp_orb {
namespace {

const std::string kCompressed = "compressed";
const std::string kOwnPlugin = "ktgp_compressed";  // see compressed_subscriber.cpp

}  // namespace

ImageInput imageInput(const ros::NodeHandle& node, const std::string& transport) {
  ImageInput input{node.resolveName("image"), transport, transport};
  const std::string suffix = "/" + kCompressed;
  const std::size_t stem = input.topic.size() - std::min(input.topic.size(), suffix.size());
  const bool named = input.topic.compare(stem, std::string::npos, suffix) == 0;
  if (named && (transport == "raw" || transport == kCompressed)) {
    input.topic.erase(stem);
    input.transport = input.plugin = kCompressed;
  }
  const auto installed = image_transport::ImageTransport(node).getLoadableTransports();
  const auto isInstalled = [&installed](const std::string& plugin) {
    return std::find(installed.begin(), installed.end(), "image_transport/" + plugin) !=
           installed.end();
  };
  if (input.transport == kCompressed && !isInstalled(kCompressed)) input.plugin = kOwnPlugin;
  if (isInstalled(input.plugin)) return input;
  throw std::invalid_argument("image transport '" + transport + "' is not installed; the package " +
                              transport +
                              "_image_transport provides it (on ROS Noetic: apt install "
                              "ros-noetic-" +
                              transport + "-image-transport)");
}

}  // namespace ktgp_orb
