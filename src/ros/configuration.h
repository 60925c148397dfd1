#pragma once

#include <ktgp_orb/GroundMotionConfig.h>
#include <ktgp_orb/KtgpConfig.h>
#include <sensor_msgs/Image.h>
#include <std_msgs/Header.h>

#include <boost/shared_ptr.hpp>
#include <cstdint>
#include <string>

#include "ktgp_orb/overlay.h"
#include "ktgp_orb/sequence_matcher.h"
#include "parameters/options.h"
#include "ros/frame_maker.h"
#include "util/grey_levels.h"

namespace ktgp_orb {

/// A consistent set of all parameters, in the types of the core and the messages.
/// parameters/table.def describes the values.
struct Configuration {
  std::uint32_t number = 0;  ///< counts the changes
  SequenceOptions sequence;
  sensor_msgs::ImageConstPtr reference_image;  ///< the initial fixed reference; null: none
  util::GreyStretch stretch =
      util::GreyStretch::percentile;  ///< how 16-bit images become 8-bit ones
  CameraView view;                    ///< for the camera's images, not for reference_image
  bool rectify = false;               ///< the lens in `view` is wanted
  std::string lens_problem;           ///< why `view` has no lens, in case of a problem
  std::string camera_problem;         ///< why `view.camera` cannot be used
  double max_rate = 0.0;              ///< Hz; 0: all frames
  OverlayStyle overlay_style = OverlayStyle::flow;
  int threads = 1;
};

using ConfigurationConstPtr = boost::shared_ptr<const Configuration>;

/// The values of dynamic_reconfigure by the names of the table.
Parameters parametersFrom(const KtgpConfig& config);

/// Everything except what comes from files and messages, which is null: the reference image, the
/// masks, the lens. Throws std::invalid_argument for values out of their limits, including NaN.
Configuration configurationFrom(const Parameters& parameters, std::uint32_t number);
Configuration configurationFrom(const KtgpConfig& config, std::uint32_t number);

/// The documented defaults. GroundMotionConfig::__getDefault__ has the same, but needs roscpp,
/// which takes time to load.
GroundMotionConfig groundMotionDefaults();

/// The frames without a leading slash, which tf2 does not know. Throws std::invalid_argument for an
/// odom_frame that tf could not place above the base, and for a readout_time without a meaning.
GroundMotionConfig usable(GroundMotionConfig config);
/// The base frame of the messages: `base_frame`, or that of the camera.
std::string baseFrame(const std_msgs::Header& image, const GroundMotionConfig& config);

}  // namespace ktgp_orb
