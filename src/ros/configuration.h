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

/// A consistent set of all parameters, converted to the types that the core and the messages use.
/// parameters/table.def describes the values.
struct Configuration {
  std::uint32_t number = 0;  ///< number of changes so far
  SequenceOptions sequence;
  sensor_msgs::ImageConstPtr reference_image;  ///< initial reference of the fixed mode; null: none
  /// `reference_image` with its features already extracted, so that the image stream need not wait
  /// for them; null: the matcher must extract them from reference_image.
  FramePtr reference_frame;
  util::GreyStretch stretch =
      util::GreyStretch::percentile;  ///< how 16-bit images are converted to 8 bits
  CameraView view;                    ///< used for the camera's images, but not for reference_image
  bool rectify = false;               ///< whether keypoints are rectified with the lens in `view`
  std::string lens_problem;           ///< reason why `view` has no lens; empty: no problem
  std::string camera_problem;         ///< reason why `view.camera` is unusable; empty: no problem
  double max_rate = 0.0;              ///< largest rate of matched frames, Hz; 0: all frames
  OverlayStyle overlay_style = OverlayStyle::flow;
  int threads = 1;
};

using ConfigurationConstPtr = boost::shared_ptr<const Configuration>;

/// Converts the values of dynamic_reconfigure to Parameters.
Parameters parametersFrom(const KtgpConfig& config);

/// Converts the parameters and checks them. Reference image, masks and lens stay empty, because the
/// caller must read them from files and messages. Throws std::invalid_argument if a value is out of
/// its range or NaN.
Configuration configurationFrom(const Parameters& parameters, std::uint32_t number);
Configuration configurationFrom(const KtgpConfig& config, std::uint32_t number);

/// The documented default values. GroundMotionConfig::__getDefault__ returns the same values, but
/// programs that use it must link roscpp, which takes time to load.
GroundMotionConfig groundMotionDefaults();

/// Checks the configuration and returns it without leading slashes in the names of tf frames, which
/// tf2 does not allow. Throws std::invalid_argument for an odom_frame that is empty or equals
/// base_frame, and for an invalid readout_time.
GroundMotionConfig usable(GroundMotionConfig config);
/// The name of the base frame for the messages: base_frame or, if it is empty, the name of the
/// camera's frame with "_level" appended.
std::string baseFrame(const std_msgs::Header& image, const GroundMotionConfig& config);

}  // namespace ktgp_orb
