#include "messages/image_conversion.h"

#include <cv_bridge/cv_bridge.h>
#include <sensor_msgs/image_encodings.h>

#include <opencv2/imgcodecs.hpp>
#include <string>

namespace ktgp_orb {
namespace {

namespace encodings = sensor_msgs::image_encodings;

std::size_t bytesPerPixel(const std::string& encoding) {
  const bool picture = encodings::isMono(encoding) || encodings::isColor(encoding) ||
                       encodings::isBayer(encoding) || encoding == encodings::YUV422 ||
                       encoding == encodings::TYPE_8UC1;
  if (!picture) {
    throw RefusedImage(
        "encoding '" + encoding +
        "' is not an image to match; expected mono8, 8UC1, mono16, a colour (bgr8, rgb8, "
        "bgra8, rgba8, 16-bit ones, yuv422) or a Bayer encoding");
  }
  return static_cast<std::size_t>(encodings::numChannels(encoding) * encodings::bitDepth(encoding) /
                                  8);
}

void requireConsistent(const sensor_msgs::Image& image) {
  if (image.width == 0 || image.height == 0) {
    throw RefusedImage("image is empty (" + std::to_string(image.width) + "x" +
                       std::to_string(image.height) + "); expected at least one pixel");
  }
  const std::size_t row_bytes = image.width * bytesPerPixel(image.encoding);
  if (image.step < row_bytes) {
    throw RefusedImage("step is " + std::to_string(image.step) + "; expected at least " +
                       std::to_string(row_bytes) + " bytes for " + std::to_string(image.width) +
                       " pixels of " + image.encoding);
  }
  const std::size_t total = std::size_t{image.step} * (image.height - 1) + row_bytes;
  if (image.data.size() < total) {
    throw RefusedImage("data has " + std::to_string(image.data.size()) +
                       " bytes; expected at least " + std::to_string(total) + " for " +
                       std::to_string(image.height) + " rows of " + std::to_string(image.step));
  }
}

cv::Mat stretchTo8Bit(const cv::Mat& image) {
  cv::Mat stretched;
  cv::normalize(image, stretched, 0, 255, cv::NORM_MINMAX, CV_8U);
  return stretched;
}

}  // namespace

cv::Mat greyImage(const sensor_msgs::ImageConstPtr& message) {
  requireConsistent(*message);
  try {
    if (message->encoding == encodings::TYPE_8UC1) return cv_bridge::toCvShare(message)->image;
    if (message->encoding == encodings::MONO16) {
      return stretchTo8Bit(cv_bridge::toCvShare(message)->image);
    }
    if (encodings::bitDepth(message->encoding) == 16) {
      return stretchTo8Bit(cv_bridge::toCvCopy(message, encodings::MONO16)->image);
    }
    return cv_bridge::toCvShare(message, encodings::MONO8)->image;
  } catch (const std::exception& error) {  // cv_bridge::Exception and cv::Exception
    throw RefusedImage("image of encoding '" + message->encoding +
                       "' cannot be converted to grey: " + error.what());
  }
}

void toFrame(const sensor_msgs::ImageConstPtr& message, Frame& frame) {
  frame.image = greyImage(message);
  frame.stamp = static_cast<std::int64_t>(message->header.stamp.toNSec());
  frame.encoding = message->encoding;
  if (frame.image.data == message->data.data()) {
    frame.source = std::shared_ptr<const void>(message.get(), [message](const void*) {});
  }
}

FramePtr makeFrame(const sensor_msgs::ImageConstPtr& message, OrbExtractor& extractor) {
  auto frame = std::make_shared<Frame>();
  toFrame(message, *frame);
  extractFeatures(extractor, *frame);
  return frame;
}

sensor_msgs::ImageConstPtr readImageFile(const std::string& path) {
  if (path.empty()) return nullptr;
  cv_bridge::CvImage image;
  image.image = cv::imread(path, cv::IMREAD_GRAYSCALE);
  image.encoding = encodings::MONO8;
  if (image.image.empty()) {
    throw RefusedImage("reference_image '" + path + "' cannot be read; expected an image file");
  }
  return image.toImageMsg();
}

}  // namespace ktgp_orb
