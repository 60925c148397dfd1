#pragma once

#include <sensor_msgs/Image.h>

#include <opencv2/core.hpp>
#include <string>

namespace ktgp_orb {

/// An image for display and its encoding.
struct ViewedImage {
  cv::Mat image;  ///< refers to the message if nothing was converted
  std::string encoding;
};

/// The image in its own encoding, but Bayer and YUV converted to bgr8, so that it can be warped.
/// Valid while `message` lives. Throws RefusedImage as greyImage does.
ViewedImage warpableImage(const sensor_msgs::ImageConstPtr& message);

/// The image as CV_8UC3 (BGR), or CV_8UC1 for grey images; 16-bit grey is stretched. Valid while
/// `message` lives. Throws RefusedImage as greyImage does.
cv::Mat colourImage(const sensor_msgs::ImageConstPtr& message);

}  // namespace ktgp_orb
