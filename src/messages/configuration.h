#pragma once

#include <ktgp_orb/KtgpConfig.h>
#include <sensor_msgs/Image.h>

#include <cstdint>

#include "ktgp_orb/sequence_matcher.h"

namespace ktgp_orb {

/// One consistent set of everything that can be tuned, as the core and the messages use it.
/// What each field means and may be stands in cfg/Ktgp.cfg.
struct Configuration {
  std::uint32_t number = 0;  ///< counts the changes
  SequenceOptions sequence;
  sensor_msgs::ImageConstPtr reference_image;  ///< the fixed reference at first; null: none
  bool overlay = true;
  int threads = 1;
};

/// All but the reference image, which is null: reading its file may fail and takes its time.
/// Throws std::invalid_argument for what the core refuses, NaN for example.
Configuration configurationFrom(const KtgpConfig& config, std::uint32_t number);

/// Throws std::invalid_argument for a name that is no mode.
ReferenceMode referenceModeFrom(const std::string& name);

}  // namespace ktgp_orb
