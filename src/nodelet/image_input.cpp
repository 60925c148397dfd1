#include "nodelet/image_input.h"

#include <image_transport/image_transport.h>

#include <algorithm>
#include <stdexcept>

namespace ktgp_orb {

void requireTransport(const ros::NodeHandle& node, const std::string& transport) {
  const auto names = image_transport::ImageTransport(node).getLoadableTransports();
  if (std::find(names.begin(), names.end(), "image_transport/" + transport) != names.end()) return;
  throw std::invalid_argument("image transport '" + transport + "' is not installed; the package " +
                              transport +
                              "_image_transport provides it (on ROS Noetic: apt install "
                              "ros-noetic-" +
                              transport + "-image-transport)");
}

}  // namespace ktgp_orb
