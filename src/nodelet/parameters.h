#pragma once

#include <ktgp_orb/KtgpConfig.h>
#include <ros/node_handle.h>
#include <sensor_msgs/Image.h>

#include <cstdint>
#include <string>
#include <vector>

#include "ktgp_orb/ktgp_matcher.h"
#include "ktgp_orb/orb_extractor.h"
#include "nodelet/reference_keeper.h"

namespace ktgp_orb {

/// One consistent set of everything that can be tuned, as the core and the nodelet use it.
/// What each field means and may be stands in cfg/Ktgp.cfg.
struct Configuration {
  std::uint32_t number = 0;  ///< counts the changes
  OrbOptions orb;
  MatcherOptions matcher;
  ReferenceOptions reference;
  sensor_msgs::ImageConstPtr reference_image;  ///< the fixed reference at first; null: none
  bool overlay = true;
  int threads = 1;
};

/// All but the reference image, which is null: reading its file may fail and takes its time.
/// Throws std::invalid_argument for what the core refuses, NaN for example.
Configuration configurationFrom(const KtgpConfig& config, std::uint32_t number);

/// Checks the parameters that `node` was started with, from a launch file, YAML or the command
/// line, which dynamic_reconfigure would clamp or ignore without a word. Throws
/// std::invalid_argument naming the parameter, its value and its range or choices.
void requireParametersInRange(const ros::NodeHandle& node);

/// Parameters below `node` that nothing reads, misspelt ones for example.
std::vector<std::string> unknownParameters(const ros::NodeHandle& node);

}  // namespace ktgp_orb
