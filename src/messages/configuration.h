#pragma once

#include <ktgp_orb/KtgpConfig.h>
#include <sensor_msgs/Image.h>

#include <cstdint>

#include "core/util/grey_levels.h"
#include "ktgp_orb/sequence_matcher.h"
#include "parameters/options.h"

namespace ktgp_orb {

/// One consistent set of everything that can be tuned, as the core and the messages use it.
/// What each field means and may be stands in parameters/table.def.
struct Configuration {
  std::uint32_t number = 0;  ///< counts the changes
  SequenceOptions sequence;
  sensor_msgs::ImageConstPtr reference_image;  ///< the fixed reference at first; null: none
  GreyStretch stretch;                         ///< of 16-bit images
  bool overlay = true;
  int threads = 1;
};

/// All but the reference image, which is null: reading its file may fail and takes its time.
/// Throws std::invalid_argument for what is out of its limits, NaN for example.
Configuration configurationFrom(const Parameters& parameters, std::uint32_t number);
Configuration configurationFrom(const KtgpConfig& config, std::uint32_t number);

}  // namespace ktgp_orb
