#pragma once

#include <sensor_msgs/Image.h>

#include <opencv2/core.hpp>
#include <string>

namespace ktgp_orb {

/// An image to be looked at and its encoding.
struct ViewedImage {
  cv::Mat image;  ///< refers to the message where nothing had to be converted
  std::string encoding;
};

/// The image as it is, but Bayer and YUV as bgr8: with pixels that can be warped. Valid while
/// `message` lives. Throws RefusedImage as greyImage does.
ViewedImage warpableImage(const sensor_msgs::ImageConstPtr& message);

/// The image as CV_8UC3 (BGR), or CV_8UC1 where it has no colour; 16-bit grey is stretched. Valid
/// while `message` lives. Throws RefusedImage as greyImage does.
cv::Mat colourImage(const sensor_msgs::ImageConstPtr& message);

}  // namespace ktgp_orb
