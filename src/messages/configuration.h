#pragma once

#include <ktgp_orb/KtgpConfig.h>
#include <sensor_msgs/Image.h>

#include <cstdint>
#include <string>

#include "core/util/grey_levels.h"
#include "ktgp_orb/overlay.h"
#include "ktgp_orb/sequence_matcher.h"
#include "messages/frame_maker.h"
#include "parameters/options.h"

namespace ktgp_orb {

/// One consistent set of everything that can be tuned, as the core and the messages use it.
/// What each field means and may be stands in parameters/table.def.
struct Configuration {
  std::uint32_t number = 0;  ///< counts the changes
  SequenceOptions sequence;
  sensor_msgs::ImageConstPtr reference_image;  ///< the fixed reference at first; null: none
  util::GreyStretch stretch;                   ///< of 16-bit images
  CameraView view;                             ///< of the camera's images, not of reference_image
  bool rectify = false;                        ///< a lens is wanted in `view`
  std::string lens_problem;                    ///< why `view` has none, where something is wrong
  double max_pair_megapixels = 64.0;           ///< 10^6 px that an image of ~match_pair may have
  double max_rate = 0.0;                       ///< Hz; 0: all frames
  bool overlay = true;
  OverlayStyle overlay_style = OverlayStyle::flow;
  int threads = 1;
};

/// All but what other files and messages hold, which is null: the reference image, the masks, the
/// lens.
/// Throws std::invalid_argument for what is out of its limits, NaN for example.
Configuration configurationFrom(const Parameters& parameters, std::uint32_t number);
Configuration configurationFrom(const KtgpConfig& config, std::uint32_t number);

}  // namespace ktgp_orb
