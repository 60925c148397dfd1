// Image messages with arbitrary fields: converted or refused.
#include <sensor_msgs/image_encodings.h>

#include <boost/make_shared.hpp>

#include "input.h"
#include "ros/image_conversion.h"
#include "ros/message_matcher.h"

namespace ktgp_orb::fuzz {
namespace {

/// Mostly consistent with the encoding.
std::uint32_t bytesPerPixel(Input& in, const std::string& encoding) {
  if (in.ConsumeIntegralInRange(0, 7) == 0) return in.ConsumeIntegralInRange(0U, 9U);
  try {
    return static_cast<std::uint32_t>(sensor_msgs::image_encodings::bitDepth(encoding) *
                                      sensor_msgs::image_encodings::numChannels(encoding) / 8);
  } catch (const std::runtime_error&) {
    return 1;
  }
}

sensor_msgs::ImagePtr message(Input& in) {
  static const char* const kEncodings[] = {
      "mono8",        "8UC1",         "mono16",       "16UC1",        "bgr8",        "8UC3",
      "rgb8",         "bgra8",        "rgba8",        "bgr16",        "rgb16",       "bgra16",
      "rgba16",       "16UC3",        "16UC4",        "yuv422",       "bayer_rggb8", "bayer_bggr8",
      "bayer_gbrg8",  "bayer_grbg8",  "bayer_rggb16", "bayer_bggr16", "8UC2",        "32FC1",
      "bayer_gbrg16", "bayer_grbg16", "32SC1",        "64FC1",        "8UC4",        ""};
  const auto image = boost::make_shared<sensor_msgs::Image>();
  image->header.stamp =
      ros::Time(in.ConsumeIntegral<std::uint16_t>(), in.ConsumeIntegralInRange(0U, 999999999U));
  image->encoding = in.ConsumeIntegralInRange(0, 15) == 0 ? in.ConsumeRandomLengthString(20)
                                                          : in.PickValueInArray(kEncodings);
  image->is_bigendian = in.ConsumeIntegralInRange(0, 2);
  const bool has_corners = in.ConsumeIntegralInRange(0, 3) == 0;
  image->width =
      has_corners ? in.ConsumeIntegralInRange(60U, 90U) : in.ConsumeIntegralInRange(0U, 40U);
  image->height =
      has_corners ? in.ConsumeIntegralInRange(60U, 90U) : in.ConsumeIntegralInRange(0U, 40U);
  image->step =
      image->width * bytesPerPixel(in, image->encoding) + in.ConsumeIntegralInRange(0U, 5U);
  std::size_t data = std::size_t{image->step} * image->height;
  switch (in.ConsumeIntegralInRange(0, 15)) {
    case 0:
      image->width = in.ConsumeIntegral<std::uint32_t>();
      break;
    case 1:
      image->height = in.ConsumeIntegral<std::uint32_t>();
      break;
    case 2:
      image->step = in.ConsumeIntegral<std::uint32_t>();
      break;
    case 3:
      data = in.ConsumeIntegralInRange<std::size_t>(0, data + 100);
      break;
    default:
      break;
  }
  const cv::Mat pixels = fuzz::image(in, {static_cast<int>(data), 1});
  image->data.assign(pixels.datastart, pixels.datastart + data);
  return image;
}

void run(Input& in) {
  static MessageMatcher matcher = [] {
    Parameters parameters;
    parameters.features = 100;
    return MessageMatcher(configurationFrom(parameters, 0));
  }();
  matcher.reset();
  for (int i = 0; i < 2; ++i) {
    const sensor_msgs::ImagePtr image = message(in);
    const auto before = image->data;
    try {
      const cv::Mat grey = greyImage(image);
      require(grey.type() == CV_8UC1 && grey.cols == static_cast<int>(image->width) &&
                  grey.rows == static_cast<int>(image->height),
              "grey of the size it says");
      const FrameMessages messages = toMessages(matcher.process(image));
      require(messages.statistics && messages.homography, "an answer for each image");
    } catch (const RefusedImage& error) {
      require(error.what()[0] != '\0', "a refusal says why");
    }
    require(before == image->data, "nothing is written into a message");
  }
}

}  // namespace
}  // namespace ktgp_orb::fuzz

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  ktgp_orb::fuzz::Input in(bytes, size);
  ktgp_orb::fuzz::run(in);
  return 0;
}
