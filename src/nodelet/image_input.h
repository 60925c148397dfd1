#pragma once

#include <ros/node_handle.h>

#include <string>

namespace ktgp_orb {

/// Throws std::invalid_argument, with advice, for an image transport that is not installed.
void requireTransport(const ros::NodeHandle& node, const std::string& transport);

}  // namespace ktgp_orb
