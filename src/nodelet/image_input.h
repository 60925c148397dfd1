#pragma once

#include <ros/node_handle.h>

#include <string>

namespace ktgp_orb {

/// The images that a node's topic `image` and its parameter ~image_transport mean.
struct ImageInput {
  std::string topic;      ///< resolved, without the name of the transport
  std::string transport;  ///< raw, compressed, ...
  std::string plugin;     ///< of image_transport, for that transport
};

/// A topic that ends in /compressed has that transport, whether or not `transport` says so. Without
/// the package compressed_image_transport the decoder of this package is used. Throws
/// std::invalid_argument, with advice, for a transport that is not installed.
ImageInput imageInput(const ros::NodeHandle& node, const std::string& transport);

}  // namespace ktgp_orb
