#include "ros/image_conversion.h"

#include <sensor_msgs/image_encodings.h>

#include <algorithm>
#include <boost/make_shared.hpp>
#include <cstdint>
#include <filesystem>
#include <opencv2/core/eigen.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <sstream>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "files/input.h"
#include "files/jpeg_data.h"
#include "files/picture_bytes.h"
#include "util/format.h"
#include "util/opacity.h"
#include "util/printable.h"

namespace ktgp_orb {
namespace {

using util::GreyStretch;
using util::stretchTo8Bit;

namespace encodings = sensor_msgs::image_encodings;

constexpr int kNoCode = -1;

/// How the pixels of an encoding lie in memory, and how they are converted to grey.
struct Format {
  std::string encoding;
  int type;              ///< OpenCV type of the pixels, such as CV_8UC3
  int to_grey;           ///< cv::cvtColor code for the conversion to grey; kNoCode if already grey
  int to_bgr = kNoCode;  ///< cv::cvtColor code for YUV to BGR; kNoCode for other formats
};

/// All supported encodings; older versions of sensor_msgs do not define uyvy, yuyv and nv*, so they
/// are written as strings. ROS names a Bayer pattern by the first pixels of the first row, but
/// OpenCV by the second and third pixel of the second row. If the name of an encoding does not say
/// which channels it has, we assume BGR, OpenCV's usual order.
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
      {encodings::YUV422, CV_8UC2, cv::COLOR_YUV2GRAY_UYVY, cv::COLOR_YUV2BGR_UYVY},
      {"uyvy", CV_8UC2, cv::COLOR_YUV2GRAY_UYVY, cv::COLOR_YUV2BGR_UYVY},
      {"yuv422_yuy2", CV_8UC2, cv::COLOR_YUV2GRAY_YUY2, cv::COLOR_YUV2BGR_YUY2},
      {"yuyv", CV_8UC2, cv::COLOR_YUV2GRAY_YUY2, cv::COLOR_YUV2BGR_YUY2},
      // In these formats, the brightness of all pixels comes first, and the colours follow. For a
      // grey image, we read only the brightness.
      {"nv12", CV_8UC1, kNoCode, cv::COLOR_YUV2BGR_NV12},
      {"nv21", CV_8UC1, kNoCode, cv::COLOR_YUV2BGR_NV21},
      {"nv24", CV_8UC1, kNoCode},
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

/// If compressed data cannot be decoded, we pass on an image without pixels whose encoding is this
/// text followed by the reason (see undecodedImage()).
constexpr char kUndecoded[] = "compressed image ";

const Format& formatOf(const std::string& encoding) {
  for (const Format& format : formats()) {
    if (format.encoding == encoding) return format;
  }
  if (encoding.rfind(kUndecoded, 0) == 0) throw RefusedImage(util::printable(encoding, 400));
  // The name comes from a message, so it may be very long: show at most this many characters.
  constexpr std::size_t kShown = 64;
  const bool is_long = encoding.size() > kShown;
  throw RefusedImage("encoding '" + encoding.substr(0, kShown) + (is_long ? "..." : "") +
                     "' is not an image to match; expected grey (mono8, mono16, 8UC1, 16UC1), "
                     "colour of 8 or 16 bits (bgr8, rgba16, 8UC3, ...), yuv422, nv12 or Bayer");
}

void requireConsistent(const sensor_msgs::Image& image, const Format& format) {
  requirePixels(image);
  if (format.to_bgr != kNoCode && format.type == CV_8UC2 && image.width % 2 != 0) {
    throw RefusedImage("width is " + std::to_string(image.width) + "; expected an even one for " +
                       image.encoding);
  }
  const std::size_t row_bytes = image.width * static_cast<std::size_t>(CV_ELEM_SIZE(format.type));
  if (image.step < row_bytes) {
    throw RefusedImage("step is " + std::to_string(image.step) + "; expected at least " +
                       std::to_string(row_bytes) + " bytes for " + std::to_string(image.width) +
                       " pixels of " + image.encoding);
  }
  if (image.step % CV_ELEM_SIZE1(format.type) != 0) {
    throw RefusedImage("step is " + std::to_string(image.step) + "; expected a multiple of " +
                       std::to_string(CV_ELEM_SIZE1(format.type)) + " bytes for " + image.encoding);
  }
  const std::size_t total = std::size_t{image.step} * (image.height - 1) + row_bytes;
  if (image.data.size() < total) {
    throw RefusedImage("data has " + std::to_string(image.data.size()) +
                       " bytes; expected at least " + std::to_string(total) + " for " +
                       std::to_string(image.height) + " rows of " + std::to_string(image.step));
  }
}

constexpr bool kHostIsBigEndian = __BYTE_ORDER__ == __ORDER_BIG_ENDIAN__;

/// The pixels of the message as a matrix that refers to the message's data. They are copied only if
/// their byte order must be changed.
cv::Mat pixelsOf(const sensor_msgs::Image& image, const Format& format) {
  // cv::Mat cannot hold const data, but we only read it.
  auto* data = const_cast<std::uint8_t*>(image.data.data());
  cv::Mat pixels(static_cast<int>(image.height), static_cast<int>(image.width), format.type, data,
                 image.step);
  const std::size_t bytes = pixels.elemSize1();
  if (bytes == 1 || (image.is_bigendian != 0) == kHostIsBigEndian) return pixels;
  cv::Mat swapped = pixels.clone();
  for (auto* value = swapped.data; value != swapped.dataend; value += bytes) {
    std::reverse(value, value + bytes);
  }
  return swapped;
}

// Megapixels; we refuse larger images in requests and in compressed data.
constexpr double kMostMegapixels = 64.0;

double megapixelsOf(const sensor_msgs::Image& image) {
  return 1e-6 * image.width * static_cast<double>(image.height);
}

/// Converts the image to `encoding` with cv_bridge; if `encoding` is empty, the encoding stays.
/// Accepts all encodings that cv_bridge knows. cv_bridge::toCvShare() would refuse images with
/// spare bytes, which greyImage() accepts, and return 16-bit pixels of the other byte order as
/// pairs of bytes.
cv_bridge::CvImageConstPtr converted(const sensor_msgs::ImageConstPtr& message,
                                     const std::string& encoding) {
  requirePixels(*message);
  try {
    const Format format{message->encoding, cv_bridge::getCvType(message->encoding), kNoCode};
    requireConsistent(*message, format);
    const auto image = boost::make_shared<cv_bridge::CvImage>(message->header, message->encoding,
                                                              pixelsOf(*message, format));
    if (encoding.empty() || encoding == message->encoding) return image;  // without a copy
    return cv_bridge::cvtColor(image, encoding);
  } catch (const RefusedImage&) {
    throw;
  } catch (const std::exception& error) {  // cv_bridge::Exception, cv::Exception
    throw RefusedImage("image of encoding '" + message->encoding +
                       "' cannot be used: " + error.what());
  }
}

/// Returns true if the encoding stores brightness and colour separately.
bool isYuv(const std::string& encoding) {
  return encoding.rfind("yuv", 0) == 0 || encoding.rfind("nv", 0) == 0 || encoding == "yuyv" ||
         encoding == "uyvy";
}

/// Converts YUV to bgr8. Returns mono8 if the colours are missing from the data, or if they are
/// stored for every pixel (nv24).
cv_bridge::CvImageConstPtr ofYuv(const sensor_msgs::ImageConstPtr& message) {
  const Format& format = formatOf(message->encoding);
  requireConsistent(*message, format);
  const auto image = boost::make_shared<cv_bridge::CvImage>();
  image->header = message->header;
  image->encoding = encodings::BGR8;
  cv::Mat pixels = pixelsOf(*message, format);
  const bool is_planar = format.type == CV_8UC1;
  const auto rows = static_cast<std::size_t>(pixels.rows) * 3 / 2;
  const bool has_colour =
      !is_planar || (pixels.cols % 2 == 0 && pixels.rows % 2 == 0 && format.to_bgr != kNoCode &&
                     message->data.size() >= message->step * rows);
  if (!has_colour) {
    image->encoding = encodings::MONO8;
    image->image = pixels.clone();
    return image;
  }
  if (is_planar) {
    pixels = cv::Mat(static_cast<int>(rows), pixels.cols, CV_8UC1, pixels.data, message->step);
  }
  cv::cvtColor(pixels, image->image, format.to_bgr);
  return image;
}

/// Decodes a compressed image; its format may be compressedDepth. Throws RefusedImage.
cv::Mat decoded(const sensor_msgs::CompressedImage& message) {
  const auto refuse = [&](const std::string& why) {
    throw RefusedImage(kUndecoded + ("(format " + util::quoted(message.format)) + ") " + why);
  };
  const auto* const data = reinterpret_cast<const char*>(message.data.data());
  std::string_view bytes(data, message.data.size());
  if (bytes.empty()) refuse("has no data");
  const bool is_depth = message.format.find("compressedDepth") != std::string::npos;
  // Size of the header of compressedDepth data in bytes. We skip this header: its enumerator and
  // two floats are needed only to decode depth in floats.
  constexpr std::size_t kDepthHeader = 12;
  if (is_depth && message.format.rfind("32FC1", 0) == 0) {
    refuse("is depth in floats; expected an image, or depth of 16UC1");
  }
  if (is_depth) bytes.remove_prefix(std::min(kDepthHeader, bytes.size()));
  const std::optional<double> megapixels = files::megapixelsOf(bytes);
  if (!megapixels) {
    refuse("is no JPEG, PNG, TIFF, WebP or BMP; expected one, or the transport of this format");
  }
  if (*megapixels > kMostMegapixels) {
    refuse(
        util::format("has %.1f megapixels; expected %.0f at most", *megapixels, kMostMegapixels));
  }
  if (files::isCutOff(bytes)) refuse("is damaged or cut off: it has no end");
  cv::Mat image;
  try {
    const cv::Mat row(1, static_cast<int>(bytes.size()), CV_8UC1,
                      const_cast<char*>(bytes.data()));  // imdecode() only reads these bytes
    image = cv::imdecode(row, cv::IMREAD_UNCHANGED);
  } catch (const cv::Exception&) {
    image.release();
  }
  if (image.empty()) refuse("cannot be decoded; it is damaged, or of a kind that OpenCV lacks");
  if (files::lacksData(bytes, image)) {
    refuse("is damaged: data are missing, and a part of the picture is grey or blurred");
  }
  return image;
}

}  // namespace

void requirePixels(const sensor_msgs::Image& image) {
  if (image.encoding.rfind(kUndecoded, 0) == 0) formatOf(image.encoding);
  if (image.width > 0 && image.height > 0) return;
  throw RefusedImage("image is empty (" + std::to_string(image.width) + "x" +
                     std::to_string(image.height) + "); expected at least one pixel");
}

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
      const cv::Mat visible = util::visiblePart(grey);
      cv::cvtColor(grey, buffer, format.to_grey);
      grey = buffer;
      util::fillHidden(visible, grey);
    }
    return grey.depth() == CV_16U ? stretchTo8Bit(grey, stretch) : grey;
  } catch (const cv::Exception& error) {
    throw RefusedImage("image of encoding '" + message->encoding +
                       "' cannot be converted to grey: " + error.what());
  }
}

cv_bridge::CvImageConstPtr warpableImage(const sensor_msgs::ImageConstPtr& message) {
  if (isYuv(message->encoding)) return ofYuv(message);
  return converted(message, encodings::isBayer(message->encoding) ? encodings::BGR8 : "");
}

bool hasBytes(const std::string& encoding) {
  return CV_MAT_DEPTH(formatOf(encoding).type) == CV_8U;
}

cv::Mat colourImage(const sensor_msgs::ImageConstPtr& message) {
  const std::string& encoding = message->encoding;
  if (isYuv(encoding)) return ofYuv(message)->image;
  const bool colour = encodings::isColor(encoding) || encodings::isBayer(encoding);
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
  image.image = decoded(message);
  const int type = image.image.type();
  const bool one_channel = image.image.channels() == 1;
  for (const Format& format : formats()) {
    // Several formats have the same OpenCV type. Choose the format that the message names; if it
    // names none, choose the first in the list, which has OpenCV's order of colours.
    const bool sent = one_channel && message.format.rfind(format.encoding + ";", 0) == 0;
    if (format.type == type && (sent || image.encoding.empty())) image.encoding = format.encoding;
  }
  if (image.encoding.empty()) {
    throw RefusedImage(std::string(kUndecoded) + "has " + cv::typeToString(type) +
                       " pixels; expected 8 or 16 bits a channel");
  }
  return image.toImageMsg();
}

sensor_msgs::ImageConstPtr undecodedImage(const std_msgs::Header& header,
                                          const RefusedImage& reason) {
  const auto image = boost::make_shared<sensor_msgs::Image>();
  image->header = header;
  image->encoding = reason.what();
  return image;
}

cv::Mat notBlack(const cv::Mat& image) {
  // do not use a fourth channel, which is opacity
  const int colours = std::min(3, image.channels());
  cv::Mat mask;
  for (int i = 0; i < colours; ++i) {
    cv::Mat channel = image;
    if (image.channels() > 1) cv::extractChannel(image, channel, i);
    const cv::Mat coloured = channel != 0;
    mask = mask.empty() ? coloured : cv::Mat(mask | coloured);
  }
  const cv::Mat visible = util::visiblePart(image);
  if (!visible.empty()) mask &= visible;
  return mask;
}

cv::Mat maskImage(const sensor_msgs::ImageConstPtr& message) {
  const Format& format = formatOf(message->encoding);
  requireConsistent(*message, format);
  const cv::Mat pixels = pixelsOf(*message, format);
  if (format.type != CV_8UC2) return notBlack(pixels);
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

/// Like files::readPicture(), but throws RefusedImage.
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
  sensor_msgs::ImageConstPtr message = image.toImageMsg();
  requireSmall(name + " " + util::printable(path), *message);
  return message;
}

cv::Mat readMaskFile(const std::string& path) {
  if (path.empty()) return {};
  cv::Mat mask = notBlack(readPicture("mask_image", path, cv::IMREAD_UNCHANGED));
  if (hidesAll(mask)) throw RefusedImage("mask_image " + util::printable(path) + ": " + kHidesAll);
  return mask;
}

bool hidesAll(const cv::Mat& mask) {
  return !mask.empty() && cv::countNonZero(mask) == 0;
}

std::string idleMask(const cv::Mat& mask) {
  if (mask.empty() || cv::countNonZero(mask) < static_cast<int>(mask.total())) return {};
  return "hides nothing: only black (0) and transparent pixels hide, and it has none";
}

}  // namespace ktgp_orb
