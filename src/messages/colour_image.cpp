#include "messages/colour_image.h"

#include <sensor_msgs/image_encodings.h>

#include <opencv2/core/eigen.hpp>
#include <opencv2/imgproc.hpp>

#include "messages/image_conversion.h"

namespace ktgp_orb {
namespace {

namespace encodings = sensor_msgs::image_encodings;

/// An empty `encoding` means no conversion.
cv_bridge::CvImageConstPtr converted(const sensor_msgs::ImageConstPtr& message,
                                     const std::string& encoding) {
  if (message->width == 0 || message->height == 0) {
    throw RefusedImage("image is empty; expected at least one pixel");
  }
  try {
    return cv_bridge::toCvShare(message, encoding);
  } catch (const std::exception& error) {  // cv_bridge::Exception, cv::Exception
    throw RefusedImage("image of encoding '" + message->encoding +
                       "' cannot be used: " + error.what());
  }
}

bool isMosaicked(const std::string& encoding) {
  return encodings::isBayer(encoding) || encoding == encodings::YUV422;
}

}  // namespace

cv_bridge::CvImageConstPtr warpableImage(const sensor_msgs::ImageConstPtr& message) {
  return converted(message, isMosaicked(message->encoding) ? encodings::BGR8 : "");
}

cv::Mat colourImage(const sensor_msgs::ImageConstPtr& message) {
  const std::string& encoding = message->encoding;
  const bool colour = encodings::isColor(encoding) || isMosaicked(encoding);
  return colour ? converted(message, encodings::BGR8)->image : greyImage(message);
}

cv::Mat warped(const cv::Mat& image, const Eigen::Matrix3d& warp) {
  cv::Mat homography;
  cv::eigen2cv(warp, homography);
  cv::Mat steady;
  cv::warpPerspective(image, steady, homography, image.size(), cv::INTER_LINEAR,
                      cv::BORDER_REPLICATE);
  return steady;
}

}  // namespace ktgp_orb
