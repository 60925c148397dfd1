#pragma once

#include <rosbag/bag.h>
#include <std_msgs/Header.h>

#include <cstdint>

#include "demo/flight.h"

namespace ktgp_orb::demo {

/// Writes the true pose and velocity of the camera at `seconds`, and the noisy readings of a range
/// sensor and an IMU beside it. The base is level if the camera looks straight down.
void writeMotion(const std_msgs::Header& image, double seconds, std::uint64_t seed,
                 const Manner& manner, rosbag::Bag& bag);

}  // namespace ktgp_orb::demo
