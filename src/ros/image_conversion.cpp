#include "ros/image_conversion.h"

#include <sensor_msgs/image_encodings.h>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <opencv2/core/eigen.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "files/input.h"

namespace ktgp_orb {
namespace {

using util::GreyStretch;
using util::stretchTo8Bit;

namespace encodings = sensor_msgs::image_encodings;

constexpr int kNoCode = -1;

/// Memory layout of an encoding's pixels, and their conversion to grey.
struct Format {
  std::string encoding;
  int type;     ///< OpenCV's type of the pixels
  int to_grey;  ///< OpenCV's conversion; kNoCode for grey pixels
};

/// All image encodings. OpenCV names a Bayer pattern by its second row from the second pixel on,
/// ROS by its first row. Channels without a name are taken as OpenCV's usual order, BGR.
const std::vector<Format>& formats() {
  static const std::vector<Format> all{
      {encodings::MONO8, CV_8UC1, kNoCode},
      {encodings::TYPE_8UC1, CV_8UC1, kNoCode},
      {encodings::MONO16, CV_16UC1, kNoCode},
      {encodings::TYPE_16UC1, CV_16UC1, kNoCode},
      {encodings::BGR8, CV_8UC3, cv::COLOR_BGR2GRAY},
      {encodings::TYPE_8UC3, CV_8UC3, cv::COLOR_BGR2GRAY},
      {encodings::RGB8, CV_8UC3, cv::COLOR_RGB2GRAY},
      {encodings::BGRA8, CV_8UC4, cv::COLOR_BGRA2GRAY},
      {encodings::TYPE_8UC4, CV_8UC4, cv::COLOR_BGRA2GRAY},
      {encodings::RGBA8, CV_8UC4, cv::COLOR_RGBA2GRAY},
      {encodings::BGR16, CV_16UC3, cv::COLOR_BGR2GRAY},
      {encodings::TYPE_16UC3, CV_16UC3, cv::COLOR_BGR2GRAY},
      {encodings::RGB16, CV_16UC3, cv::COLOR_RGB2GRAY},
      {encodings::BGRA16, CV_16UC4, cv::COLOR_BGRA2GRAY},
      {encodings::TYPE_16UC4, CV_16UC4, cv::COLOR_BGRA2GRAY},
      {encodings::RGBA16, CV_16UC4, cv::COLOR_RGBA2GRAY},
      {encodings::YUV422, CV_8UC2, cv::COLOR_YUV2GRAY_UYVY},
      {encodings::BAYER_RGGB8, CV_8UC1, cv::COLOR_BayerBG2GRAY},
      {encodings::BAYER_BGGR8, CV_8UC1, cv::COLOR_BayerRG2GRAY},
      {encodings::BAYER_GBRG8, CV_8UC1, cv::COLOR_BayerGR2GRAY},
      {encodings::BAYER_GRBG8, CV_8UC1, cv::COLOR_BayerGB2GRAY},
      {encodings::BAYER_RGGB16, CV_16UC1, cv::COLOR_BayerBG2GRAY},
      {encodings::BAYER_BGGR16, CV_16UC1, cv::COLOR_BayerRG2GRAY},
      {encodings::BAYER_GBRG16, CV_16UC1, cv::COLOR_BayerGR2GRAY},
      {encodings::BAYER_GRBG16, CV_16UC1, cv::COLOR_BayerGB2GRAY},
  };
  return all;
}

const Format& formatOf(const std::string& encoding) {
  for (const Format& format : formats()) {
    if (format.encoding == encoding) return format;
  }
  constexpr std::size_t kShown = 64;  // characters of an untrusted name
  const bool is_long = encoding.size() > kShown;
  throw RefusedImage("encoding '" + encoding.substr(0, kShown) + (is_long ? "..." : "") +
                     "' is not an image to match; expected grey (mono8, mono16, 8UC1, 16UC1), "
                     "colour of 8 or 16 bits (bgr8, rgba16, 8UC3, ...), yuv422 or Bayer");
}

void requireConsistent(const sensor_msgs::Image& image, const Format& format) {
  if (image.width == 0 || image.height == 0) {
    throw RefusedImage("image is empty (" + std::to_string(image.width) + "x" +
                       std::to_string(image.height) + "); expected at least one pixel");
  }
  const std::size_t row_bytes = image.width * static_cast<std::size_t>(CV_ELEM_SIZE(format.type));
  if (image.step < row_bytes) {
    throw RefusedImage("step is " + std::to_string(image.step) + "; expected at least " +
                       std::to_string(row_bytes) + " bytes for " + std::to_string(image.width) +
                       " pixels of " + image.encoding);
  }
  if (image.step % CV_ELEM_SIZE1(format.type) != 0) {
    throw RefusedImage("step is " + std::to_string(image.step) +
                       "; expected an even number of bytes for 16-bit pixels");
  }
  const std::size_t total = std::size_t{image.step} * (image.height - 1) + row_bytes;
  if (image.data.size() < total) {
    throw RefusedImage("data has " + std::to_string(image.data.size()) +
                       " bytes; expected at least " + std::to_string(total) + " for " +
                       std::to_string(image.height) + " rows of " + std::to_string(image.step));
  }
}

constexpr bool kHostIsBigEndian = __BYTE_ORDER__ == __ORDER_BIG_ENDIAN__;

/// The pixels without a copy, unless the order of bytes must be changed.
cv::Mat pixelsOf(const sensor_msgs::Image& image, const Format& format) {
  // OpenCV has no view of constant data; this one is only read.
  auto* data = const_cast<std::uint8_t*>(image.data.data());
  cv::Mat pixels(static_cast<int>(image.height), static_cast<int>(image.width), format.type, data,
                 image.step);
  if (pixels.elemSize1() != 2 || (image.is_bigendian != 0) == kHostIsBigEndian) return pixels;
  cv::Mat swapped = pixels.clone();
  for (auto* byte = swapped.data; byte != swapped.dataend; byte += 2) std::swap(byte[0], byte[1]);
  return swapped;
}

constexpr double kMostMegapixels = 64.0;  // largest image of a request

double megapixelsOf(const sensor_msgs::Image& image) {
  return 1e-6 * image.width * static_cast<double>(image.height);
}

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

void requireSmall(const std::string& name, const sensor_msgs::Image& image) {
  const double megapixels = megapixelsOf(image);
  if (megapixels <= kMostMegapixels) return;
  std::ostringstream text;
  text << name << " is " << image.width << "x" << image.height << " (" << megapixels
       << " megapixels); expected " << kMostMegapixels << " at most";
  throw RefusedImage(text.str());
}

void requireSmall(const std::string& name, const std::vector<sensor_msgs::Image>& images) {
  constexpr std::size_t kMostImages = 64;
  double megapixels = 0.0;
  for (const sensor_msgs::Image& image : images) {
    requireSmall("one of " + name, image);
    megapixels += megapixelsOf(image);
  }
  if (images.size() <= kMostImages && megapixels <= kMostMegapixels) return;
  std::ostringstream text;
  text << name << " are " << images.size() << " with " << megapixels << " megapixels; expected "
       << kMostImages << " images with " << kMostMegapixels << " megapixels at most";
  throw RefusedImage(text.str());
}

cv::Mat greyImage(const sensor_msgs::ImageConstPtr& message, GreyStretch stretch) {
  cv::Mat buffer;
  return greyImage(message, stretch, buffer);
}

cv::Mat greyImage(const sensor_msgs::ImageConstPtr& message, GreyStretch stretch, cv::Mat& buffer) {
  const Format& format = formatOf(message->encoding);
  requireConsistent(*message, format);
  try {
    cv::Mat grey = pixelsOf(*message, format);
    if (format.to_grey != kNoCode) {
      cv::cvtColor(grey, buffer, format.to_grey);
      grey = buffer;
    }
    return grey.depth() == CV_16U ? stretchTo8Bit(grey, stretch) : grey;
  } catch (const cv::Exception& error) {
    throw RefusedImage("image of encoding '" + message->encoding +
                       "' cannot be converted to grey: " + error.what());
  }
}

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

sensor_msgs::ImageConstPtr decodedImage(const sensor_msgs::CompressedImage& message) {
  cv_bridge::CvImage image;
  image.header = message.header;
  if (message.data.empty()) return nullptr;
  try {
    image.image = cv::imdecode(message.data, cv::IMREAD_UNCHANGED);
  } catch (const cv::Exception&) {  // data that OpenCV takes for an image too large for it
    return nullptr;
  }
  const int type = image.image.type();
  const bool one_channel = image.image.channels() == 1;
  for (const Format& format : formats()) {
    // OpenCV's order of colours comes first in the list.
    const bool sent = one_channel && message.format.rfind(format.encoding + ";", 0) == 0;
    if (format.type == type && (sent || image.encoding.empty())) image.encoding = format.encoding;
  }
  if (image.image.empty() || image.encoding.empty()) return nullptr;
  return image.toImageMsg();
}

cv::Mat notBlack(const cv::Mat& image) {
  const int colours = std::min(3, image.channels());  // a fourth is opacity
  cv::Mat mask;
  for (int i = 0; i < colours; ++i) {
    cv::Mat channel = image;
    if (image.channels() > 1) cv::extractChannel(image, channel, i);
    const cv::Mat coloured = channel != 0;
    mask = mask.empty() ? coloured : cv::Mat(mask | coloured);
  }
  return mask;
}

cv::Mat maskImage(const sensor_msgs::ImageConstPtr& message) {
  const Format& format = formatOf(message->encoding);
  requireConsistent(*message, format);
  const cv::Mat pixels = pixelsOf(*message, format);
  const bool is_yuv = message->encoding == encodings::YUV422;
  if (!is_yuv) return notBlack(pixels);
  cv::Mat luma;
  cv::cvtColor(pixels, luma, format.to_grey);
  return notBlack(luma);
}

void toFrame(const sensor_msgs::ImageConstPtr& message, GreyStretch stretch, Frame& frame) {
  toFrame(message, stretch, std::make_shared<PixelMemory>(), frame);
}

void toFrame(const sensor_msgs::ImageConstPtr& message, GreyStretch stretch,
             const std::shared_ptr<PixelMemory>& memory, Frame& frame) {
  frame.image = greyImage(message, stretch, memory->grey);
  frame.stamp = static_cast<std::int64_t>(message->header.stamp.toNSec());
  frame.encoding = message->encoding;
  if (frame.image.data == message->data.data()) memory->message = message;
  frame.source = memory;
}

FramePtr makeFrame(const sensor_msgs::ImageConstPtr& message, OrbExtractor& extractor,
                   GreyStretch stretch) {
  auto frame = std::make_shared<Frame>();
  toFrame(message, stretch, *frame);
  extractFeatures(extractor, *frame);
  return frame;
}

namespace {

/// Throws RefusedImage.
cv::Mat readPicture(const std::string& name, const std::string& path, int flags) {
  try {
    return files::readPicture(path, flags);
  } catch (const files::FileError& error) {
    std::error_code unused;
    const std::filesystem::path here = std::filesystem::current_path(unused);
    const bool is_relative = std::filesystem::path(path).is_relative();
    throw RefusedImage(name + " " + error.what() +
                       (is_relative ? "; it was looked for in " + here.string() : ""));
  }
}

}  // namespace

sensor_msgs::ImageConstPtr readImageFile(const std::string& name, const std::string& path) {
  if (path.empty()) return nullptr;
  cv_bridge::CvImage image;
  image.image = readPicture(name, path, cv::IMREAD_GRAYSCALE | cv::IMREAD_ANYDEPTH);
  image.encoding = image.image.depth() == CV_16U ? encodings::MONO16 : encodings::MONO8;
  return image.toImageMsg();
}

cv::Mat readMaskFile(const std::string& path) {
  return path.empty() ? cv::Mat() : notBlack(readPicture("mask_image", path, cv::IMREAD_UNCHANGED));
}

}  // namespace ktgp_orb
