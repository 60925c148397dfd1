#pragma once

#include <cv_bridge/cv_bridge.h>
#include <sensor_msgs/Image.h>

#include <Eigen/Core>
#include <opencv2/core.hpp>

namespace ktgp_orb {

/// The image in its own encoding, but Bayer and YUV converted to bgr8, so that it can be warped.
/// Throws RefusedImage as greyImage does.
cv_bridge::CvImageConstPtr warpableImage(const sensor_msgs::ImageConstPtr& message);

/// The image as CV_8UC3 (BGR), or CV_8UC1 for grey images; 16-bit grey is stretched. Valid while
/// `message` lives. Throws RefusedImage as greyImage does.
cv::Mat colourImage(const sensor_msgs::ImageConstPtr& message);

/// The image after a stabilizer's `warp`, of the same size; where it ends, its border goes on.
cv::Mat warped(const cv::Mat& image, const Eigen::Matrix3d& warp);

}  // namespace ktgp_orb
