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
  std::uint32_t number = 0;  ///< number of changes so far
  SequenceOptions sequence;
  sensor_msgs::ImageConstPtr reference_image;  ///< the initial fixed reference; null: none
  /// `reference_image` with its features, so that the stream need not wait for them; null: the
  /// stream extracts them from reference_image.
  FramePtr reference_frame;
  util::GreyStretch stretch =
      util::GreyStretch::percentile;  ///< how 16-bit images are converted to 8 bits
  CameraView view;             ///< applies to the images of the camera, not to reference_image
  bool rectify = false;        ///< whether points should be rectified with the lens in `view`
  std::string lens_problem;    ///< why `view` has no lens; empty: no problem
  std::string camera_problem;  ///< why `view.camera` cannot be used; empty: no problem
  double max_rate = 0.0;       ///< Hz; 0: all frames
  OverlayStyle overlay_style = OverlayStyle::flow;
  int threads = 1;
};

using ConfigurationConstPtr = boost::shared_ptr<const Configuration>;

/// Converts the values of dynamic_reconfigure to Parameters.
Parameters parametersFrom(const KtgpConfig& config);

/// Converts the parameters. Reference image, masks and lens stay null, since they come from files
/// and messages. Throws std::invalid_argument for values out of their limits, or NaN.
Configuration configurationFrom(const Parameters& parameters, std::uint32_t number);
Configuration configurationFrom(const KtgpConfig& config, std::uint32_t number);

/// The documented defaults. GroundMotionConfig::__getDefault__ returns the same, but needs roscpp,
/// which takes time to load.
GroundMotionConfig groundMotionDefaults();

/// Removes the leading slash of frames, which tf2 does not allow. Throws std::invalid_argument for
/// an odom_frame that is empty or equals base_frame, and for an invalid readout_time.
GroundMotionConfig usable(GroundMotionConfig config);
/// The base frame of the messages: base_frame or, without it, the camera's frame with "_level".
std::string baseFrame(const std_msgs::Header& image, const GroundMotionConfig& config);

}  // namespace ktgp_orb
