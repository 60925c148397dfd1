#pragma once

#include <sensor_msgs/Image.h>

#include <memory>
#include <opencv2/core.hpp>

#include "ktgp_orb/features.h"
#include "ktgp_orb/orb_extractor.h"

namespace ktgp_orb {

/// An image of the stream with what was found in it. A mono8 image is held by its message, so that
/// inside one nodelet manager no pixel is ever copied.
struct Frame {
  sensor_msgs::ImageConstPtr message;  ///< keeps the pixels of `grey` alive
  cv::Mat grey;                        ///< CV_8UC1
  Features features;
  OrbOptions orb;  ///< that `features` was found with
  double extraction_milliseconds = 0.0;
};

using FramePtr = std::shared_ptr<Frame>;

/// Converts the image and finds its features. Throws RefusedImage for an image of no use.
FramePtr makeFrame(const sensor_msgs::ImageConstPtr& message, OrbExtractor& extractor);

/// Finds the features of `frame` again, after the extractor's options have changed.
void extractAgain(OrbExtractor& extractor, Frame& frame);

}  // namespace ktgp_orb
