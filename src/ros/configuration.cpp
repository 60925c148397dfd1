#include "ros/configuration.h"

#include <stdexcept>

#include "util/camera_check.h"
#include "util/format.h"
#include "util/options_check.h"

namespace ktgp_orb {

Parameters parametersFrom(const KtgpConfig& config) {
  Parameters p;
#define KTGP_ROW(name, value, ...) p.name = config.name;
#include "parameters/each_row.def"
#include "parameters/table.def"
#include "parameters/table_end.def"
  return p;
}

Configuration configurationFrom(const KtgpConfig& config, std::uint32_t number) {
  return configurationFrom(parametersFrom(config), number);
}

Configuration configurationFrom(const Parameters& parameters, std::uint32_t number) {
  Configuration c;
  c.number = number;
  c.sequence = sequenceOptions(parameters);
  c.stretch =
      parameters.stretch == "percentile" ? util::GreyStretch::percentile : util::GreyStretch::range;
  c.view.roi = roiFrom(parameters.roi);
  c.rectify = parameters.rectify;
  c.max_rate = parameters.max_rate;
  c.overlay_style = overlayStyleFrom(parameters);
  c.threads = parameters.threads;
  // The constructor of SequenceMatcher checks the other options. For this check, limit the options
  // to one thread, so that the constructor starts no threads.
  util::requireInRange("threads", parameters.threads, 0, 256);
  SequenceOptions options = c.sequence;
  options.orb.threads = options.matcher.knn.threads = 1;
  const SequenceMatcher checked(options);
  return c;
}

GroundMotionConfig groundMotionDefaults() {
  GroundMotionConfig config;
#define KTGP_ROW(name, value, ...) config.name = value;
#include "parameters/each_row.def"
#include "parameters/ground_motion.def"
#include "parameters/table_end.def"
  return config;
}

GroundMotionConfig usable(GroundMotionConfig config) {
  util::requireReadoutTime(config.readout_time);
  for (std::string* frame : {&config.base_frame, &config.odom_frame, &config.ground_frame}) {
    *frame = util::withoutSlash(*frame);
  }
  if (config.odom_frame.empty() || config.odom_frame == config.base_frame) {
    throw std::invalid_argument(
        "odom_frame is " + (config.odom_frame.empty() ? std::string("empty") : config.odom_frame) +
        "; expected a frame other than base_frame");
  }
  return config;
}

std::string baseFrame(const std_msgs::Header& image, const GroundMotionConfig& config) {
  if (!config.base_frame.empty()) return config.base_frame;
  return util::withoutSlash(image.frame_id) + "_level";
}

}  // namespace ktgp_orb
