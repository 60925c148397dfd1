#include "messages/colour_image.h"

#include <cv_bridge/cv_bridge.h>
#include <sensor_msgs/image_encodings.h>

#include "messages/image_conversion.h"

namespace ktgp_orb {
namespace {

namespace encodings = sensor_msgs::image_encodings;

/// An empty `encoding` means no conversion.
ViewedImage converted(const sensor_msgs::ImageConstPtr& message, const std::string& encoding) {
  if (message->width == 0 || message->height == 0) {
    throw RefusedImage("image is empty; expected at least one pixel");
  }
  try {
    const cv_bridge::CvImageConstPtr image = cv_bridge::toCvShare(message, encoding);
    return {image->image, image->encoding};
  } catch (const std::exception& error) {  // cv_bridge::Exception, cv::Exception
    throw RefusedImage("image of encoding '" + message->encoding +
                       "' cannot be used: " + error.what());
  }
}

bool isMosaicked(const std::string& encoding) {
  return encodings::isBayer(encoding) || encoding == encodings::YUV422;
}

}  // namespace

ViewedImage warpableImage(const sensor_msgs::ImageConstPtr& message) {
  return converted(message, isMosaicked(message->encoding) ? encodings::BGR8 : "");
}

cv::Mat colourImage(const sensor_msgs::ImageConstPtr& message) {
  const std::string& encoding = message->encoding;
  const bool colour = encodings::isColor(encoding) || isMosaicked(encoding);
  return colour ? converted(message, encodings::BGR8).image : greyImage(message);
}

}  // namespace ktgp_orb
