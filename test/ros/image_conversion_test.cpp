// Conversion of every encoding of sensor_msgs. No ROS master is needed.
#include "ros/image_conversion.h"

#include <gtest/gtest.h>
#include <sensor_msgs/image_encodings.h>
#include <sys/stat.h>

#include <cv_bridge/cv_bridge.h>
#include <boost/make_shared.hpp>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <regex>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "files/input.h"
#include "files/picture_bytes.h"
#include "orb_test_images.h"
#include "refusal.h"
#include "ros/camera.h"
#include "ros/frame_maker.h"
#include "ros/message_conversion.h"
#include "ros/message_matcher.h"
#include "ros/rate_limiter.h"

namespace ktgp_orb {
namespace {

using test::expectRefused;
using test::refusalOf;
using util::GreyStretch;

constexpr int kWidth = 64;
constexpr int kHeight = 48;

/// A smooth picture, so that Bayer patterns can be interpolated.
cv::Mat grey() {
  return test::drawn({kWidth, kHeight}, [](int x, int y) { return 3 * x + y; });
}

/// All grey values once, so that stretching does not change them.
constexpr GreyStretch kAsTheyAre = GreyStretch::range;

cv::Mat sixteenBits(const cv::Mat& image) {
  cv::Mat out;
  image.convertTo(out, CV_16U, 257.0);
  return out;
}

/// Red, green and blue planes that differ: 40, 120 and 200 plus a little of the picture.
cv::Mat colour(int blue, int green, int red) {
  cv::Mat small = grey() / 8;
  cv::Mat out;
  cv::merge(std::vector<cv::Mat>{small + blue, small + green, small + red}, out);
  return out;
}

cv::Mat withAlpha(const cv::Mat& image) {
  std::vector<cv::Mat> planes;
  cv::split(image, planes);
  planes.emplace_back(image.size(), planes[0].type(), cv::Scalar(255));
  cv::Mat out;
  cv::merge(planes, out);
  return out;
}

/// `red` at position (x, y) of each 2x2 block, blue at the opposite one, green at the others.
cv::Mat bayer(int x, int y) {
  const cv::Mat light = grey() / 8;
  return test::drawn(light.size(), [&](int column, int row) {
    const bool is_red = row % 2 == y && column % 2 == x;
    const bool is_blue = row % 2 != y && column % 2 != x;
    return light.at<uchar>(row, column) + (is_red ? 200 : is_blue ? 40 : 120);
  });
}

cv::Mat uyvy() {
  cv::Mat out;
  cv::merge(std::vector<cv::Mat>{cv::Mat(kHeight, kWidth, CV_8U, cv::Scalar(128)), grey()}, out);
  return out;
}

cv::Mat yuyv() {
  cv::Mat out;
  cv::merge(std::vector<cv::Mat>{grey(), cv::Mat(kHeight, kWidth, CV_8U, cv::Scalar(128))}, out);
  return out;
}

boost::shared_ptr<sensor_msgs::Image> messageOf(const std::string& encoding, const cv::Mat& pixels,
                                                int padding = 0) {
  auto message = boost::make_shared<sensor_msgs::Image>();
  message->encoding = encoding;
  message->width = static_cast<std::uint32_t>(pixels.cols);
  message->height = static_cast<std::uint32_t>(pixels.rows);
  const std::size_t row = pixels.cols * pixels.elemSize();
  message->step = static_cast<std::uint32_t>(row + static_cast<std::size_t>(padding));
  message->data.assign(message->step * message->height, 77);
  for (int y = 0; y < pixels.rows; ++y) {
    std::copy_n(pixels.ptr(y), row, &message->data[y * message->step]);
  }
  return message;
}

/// 0.299 R + 0.587 G + 0.114 B of red 200, green 120, blue 40, plus an eighth of the picture.
cv::Mat expectedOfColour() {
  return grey() / 8 + static_cast<int>(0.299 * 200 + 0.587 * 120 + 0.114 * 40 + 0.5);
}

struct Expectation {
  cv::Mat pixels;
  cv::Mat grey;
};

/// Every accepted encoding, with a picture and the expected result.
std::map<std::string, Expectation> taken() {
  const cv::Mat bgr = colour(40, 120, 200);
  const cv::Mat rgb = colour(200, 120, 40);
  const cv::Mat mixed = expectedOfColour();
  std::map<std::string, Expectation> all;
  for (const char* name : {"mono8", "8UC1"}) all[name] = {grey(), grey()};
  for (const char* name : {"mono16", "16UC1"}) all[name] = {sixteenBits(grey()), grey()};
  for (const char* name : {"bgr8", "8UC3"}) all[name] = {bgr, mixed};
  for (const char* name : {"bgra8", "8UC4"}) all[name] = {withAlpha(bgr), mixed};
  for (const char* name : {"bgr16", "16UC3"}) all[name] = {sixteenBits(bgr), mixed};
  for (const char* name : {"bgra16", "16UC4"}) all[name] = {sixteenBits(withAlpha(bgr)), mixed};
  all["rgb8"] = {rgb, mixed};
  all["rgba8"] = {withAlpha(rgb), mixed};
  all["rgb16"] = {sixteenBits(rgb), mixed};
  all["rgba16"] = {sixteenBits(withAlpha(rgb)), mixed};
  for (const char* name : {"yuv422", "uyvy"}) all[name] = {uyvy(), grey()};
  for (const char* name : {"yuv422_yuy2", "yuyv"}) all[name] = {yuyv(), grey()};
  for (const char* name : {"nv12", "nv21", "nv24"}) all[name] = {grey(), grey()};
  const std::map<std::string, cv::Mat> patterns{{"bayer_rggb", bayer(0, 0)},
                                                {"bayer_grbg", bayer(1, 0)},
                                                {"bayer_gbrg", bayer(0, 1)},
                                                {"bayer_bggr", bayer(1, 1)}};
  for (const auto& [name, pixels] : patterns) {
    all[name + "8"] = {pixels, mixed};
    all[name + "16"] = {sixteenBits(pixels), mixed};
  }
  return all;
}

/// Signed, floating-point and two-channel values are not pictures: depth, flow, disparity.
const std::set<std::string> kRefused{"8UC2",  "8SC1",  "8SC2",  "8SC3",  "8SC4",  "16UC2",
                                     "16SC1", "16SC2", "16SC3", "16SC4", "32SC1", "32SC2",
                                     "32SC3", "32SC4", "32FC1", "32FC2", "32FC3", "32FC4",
                                     "64FC1", "64FC2", "64FC3", "64FC4"};

/// Names in the header of sensor_msgs itself, whatever its version.
std::set<std::string> encodingsOfSensorMsgs() {
  std::ifstream in(KTGP_ORB_ENCODINGS_HEADER);
  const std::regex constant("const std::string [A-Z0-9_]+ *= *\"([^\"]+)\"");
  std::set<std::string> names;
  for (std::string line; std::getline(in, line);) {
    std::smatch match;
    if (std::regex_search(line, match, constant)) names.insert(match[1]);
  }
  return names;
}

/// Largest difference within the border of 2 px, where Bayer patterns have no neighbours.
double difference(const cv::Mat& a, const cv::Mat& b) {
  const cv::Rect inside(2, 2, kWidth - 4, kHeight - 4);
  return cv::norm(a(inside), b(inside), cv::NORM_INF);
}

TEST(Encodings, EachIsTakenOrRefused) {
  const std::set<std::string> known = encodingsOfSensorMsgs();
  ASSERT_GT(known.size(), 40u) << KTGP_ORB_ENCODINGS_HEADER;
  const auto all = taken();
  for (const std::string& name : known) {
    EXPECT_NE(all.count(name), kRefused.count(name)) << name << " has no line in this test";
  }
}

TEST(Encodings, AcceptedOnesBecomeGrey) {
  for (const auto& [name, expected] : taken()) {
    for (int padding : {0, 6}) {
      const auto message = messageOf(name, expected.pixels, padding);
      const cv::Mat seen = greyImage(message, kAsTheyAre);
      ASSERT_EQ(seen.type(), CV_8UC1) << name;
      ASSERT_EQ(seen.size(), cv::Size(kWidth, kHeight)) << name;
      EXPECT_LE(difference(seen, expected.grey), 2.0) << name << ", padding " << padding;
    }
  }
}

TEST(Encodings, RefusedOnesAreNamed) {
  std::set<std::string> names = kRefused;
  names.insert({"", "no such encoding", "yuv420", "jpeg"});
  for (const std::string& name : names) {
    const auto message = messageOf(name, cv::Mat::zeros(kHeight, kWidth, CV_64FC4));
    for (const std::string& words : {"'" + name + "'", std::string("expected")}) {
      expectRefused<RefusedImage>([&] { greyImage(message); }, words);
    }
  }
}

TEST(Encodings, SixteenBitsInEitherByteOrder) {
  for (const char* name : {"mono16", "bgr16", "bayer_rggb16"}) {
    const Expectation expected = taken().at(name);
    auto swapped = messageOf(name, expected.pixels);
    for (std::size_t i = 0; i < swapped->data.size(); i += 2) {
      std::swap(swapped->data[i], swapped->data[i + 1]);
    }
    swapped->is_bigendian = 1;
    EXPECT_LE(difference(greyImage(swapped, kAsTheyAre), expected.grey), 2.0) << name;
  }
  auto bytes = messageOf("mono8", grey());
  bytes->is_bigendian = 1;
  EXPECT_EQ(difference(greyImage(bytes), grey()), 0.0) << "one byte has no order";
}

TEST(Encodings, AllReadersOfOneImageAcceptTheSameBytes) {
  for (const char* name : {"mono16", "bgr16", "bayer_rggb16", "bgr8", "32FC1"}) {
    cv::Mat pixels;
    if (std::string(name) == "32FC1") {
      grey().convertTo(pixels, CV_32F, 0.01);
    } else {
      pixels = taken().at(name).pixels;
    }
    const auto plain = messageOf(name, pixels);
    const std::size_t bytes = pixels.elemSize1();
    const auto other_order = messageOf(name, pixels);
    for (auto value = other_order->data.begin(); value != other_order->data.end(); value += bytes) {
      std::reverse(value, value + static_cast<std::ptrdiff_t>(bytes));
    }
    other_order->is_bigendian = 1;
    const auto spare = messageOf(name, pixels, 16);
    spare->data.resize(spare->data.size() + 64);
    const auto without_last_padding = messageOf(name, pixels, 16);
    without_last_padding->data.resize(without_last_padding->data.size() - 16);
    for (const auto& message : {other_order, spare, without_last_padding}) {
      EXPECT_EQ(difference(warpableImage(message)->image, warpableImage(plain)->image), 0.0)
          << name;
      if (bytes == 4) continue;  // neither the matcher nor a picture can use it
      EXPECT_EQ(difference(greyImage(message), greyImage(plain)), 0.0) << name;
      EXPECT_EQ(difference(colourImage(message), colourImage(plain)), 0.0) << name;
    }
  }
}

TEST(Encodings, GreyOnesAreNotCopied) {
  for (const char* name : {"mono8", "8UC1"}) {
    const auto message = messageOf(name, grey());
    EXPECT_EQ(greyImage(message).data, message->data.data());
  }
}

TEST(Encodings, SixteenBitsAreStretched) {
  cv::Mat thermal;
  grey().convertTo(thermal, CV_16U, 1.0, 30000.0);
  thermal.at<std::uint16_t>(5, 5) = 65535;
  const cv::Mat seen = greyImage(messageOf("16UC1", thermal));
  EXPECT_GT(seen.at<uchar>(40, 60) - seen.at<uchar>(2, 2), 180) << "one hot pixel dims nothing";
}

TEST(Sizes, MoreDataThanNeededIsTaken) {
  const auto message = messageOf("mono8", grey(), 10);
  message->data.insert(message->data.end(), 1000, 0);
  EXPECT_EQ(difference(greyImage(message), grey()), 0.0);
  message->data.resize(message->step * (message->height - 1) + message->width);
  EXPECT_EQ(difference(greyImage(message), grey()), 0.0) << "the last row needs no padding";
}

TEST(Sizes, WrongSizesAreRefused) {
  using Change = std::function<void(sensor_msgs::Image&)>;
  const std::map<std::string, Change> changes{
      {"step is 63; expected at least 64", [](auto& m) { m.step = 63; }},
      {"image is empty (0x48)", [](auto& m) { m.width = 0; }},
      {"data has 100 bytes; expected at least 3072", [](auto& m) { m.data.resize(100); }}};
  for (const auto& [text, change] : changes) {
    const auto message = messageOf("mono8", grey());
    change(*message);
    expectRefused<RefusedImage>([&] { greyImage(message); }, text);
  }
  const auto odd = messageOf("mono16", sixteenBits(grey()), 1);
  EXPECT_THROW(greyImage(odd), RefusedImage);
}

TEST(Sizes, RequestsAreBoundedPerImageAndInAll) {
  sensor_msgs::Image image;
  image.width = image.height = 8000;
  std::vector<sensor_msgs::Image> images(1, image);
  EXPECT_NO_THROW(requireSmall("the image", image));
  EXPECT_NO_THROW(requireSmall("the images", images));
  images.emplace_back();
  images.back().width = images.back().height = 1000;
  EXPECT_EQ(refusalOf<RefusedImage>([&] { requireSmall("the images", images); }),
            "the images are 2 with 65 megapixels; expected 64 images with 64 megapixels at most");
  image.width = 8001;
  expectRefused<RefusedImage>([&] { requireSmall("the image", image); }, "the image is 8001x8000");
  images.assign(65, sensor_msgs::Image());
  expectRefused<RefusedImage>([&] { requireSmall("the images", images); },
                              "the images are 65 with 0 megapixels");
  images.resize(64);
  EXPECT_NO_THROW(requireSmall("the images", images));
}

TEST(Files, SixteenBitFilesConvertLikeMessages) {
  cv::Mat twelve_bits;
  grey().convertTo(twelve_bits, CV_16U, 16.0);
  const std::string path = ::testing::TempDir() + "ktgp_orb_image_conversion_test.png";
  ASSERT_TRUE(cv::imwrite(path, twelve_bits));
  const sensor_msgs::ImageConstPtr file = readImageFile("reference_image", path);
  EXPECT_EQ(file->encoding, "mono16");
  EXPECT_EQ(difference(greyImage(file), greyImage(messageOf("mono16", twelve_bits))), 0.0);
  EXPECT_GT(greyImage(file).at<uchar>(47, 63), 250) << "and not dark";
  std::remove(path.c_str());
}

// Their black and white are not known.
TEST(Files, FloatFilesAreRefusedWithTheSameWords) {
  for (const int type : {CV_32FC1, CV_32FC3, CV_64FC1}) {
    const std::string path = ::testing::TempDir() + "ktgp_orb_image_conversion_float.tiff";
    ASSERT_TRUE(cv::imwrite(path, cv::Mat(48, 64, type, cv::Scalar::all(0.5))));
    const std::vector<std::function<void()>> readers{
        [&] { files::readGrey(path); }, [&] { readImageFile("reference_image", path); },
        [&] { readMaskFile(path); }};
    for (const auto& read : readers) {
      const std::string depth = CV_MAT_DEPTH(type) == CV_32F ? "CV_32F" : "CV_64F";
      expectRefused<std::runtime_error>(
          read, "has " + depth + " pixels; expected a picture of 8 or 16 bits a channel");
    }
    std::remove(path.c_str());
  }
}

// Opening a pipe would block until it has a writer.
TEST(Files, IrregularFilesAreRefused) {
  const std::string path = ::testing::TempDir() + "ktgp_orb_image_conversion_pipe";
  std::remove(path.c_str());
  ASSERT_EQ(mkfifo(path.c_str(), 0600), 0);
  for (const std::string& name : {path, std::string("/dev/null"), ::testing::TempDir()}) {
    EXPECT_EQ(refusalOf<RefusedImage>([&] { readImageFile("mask_image", name); }),
              "mask_image " + name + ": is not a regular file");
  }
  std::remove(path.c_str());
}

/// `hidden` of a black image; the rest has the darkest value that is not black.
void expectMask(const sensor_msgs::ImageConstPtr& message) {
  const cv::Mat mask = maskImage(message);
  ASSERT_EQ(mask.type(), CV_8UC1) << message->encoding;
  EXPECT_EQ(cv::countNonZero(mask(cv::Rect(0, 0, kWidth / 2, kHeight))), 0) << message->encoding;
  EXPECT_EQ(cv::countNonZero(mask), kWidth / 2 * kHeight) << message->encoding;
}

TEST(Masks, BlackHidesAndEverythingElseIsLookedAtInEveryEncoding) {
  for (const auto& [encoding, expectation] : taken()) {
    cv::Mat pixels(expectation.pixels.size(), expectation.pixels.type(), cv::Scalar::all(0));
    pixels(cv::Rect(kWidth / 2, 0, kWidth / 2, kHeight)).setTo(cv::Scalar::all(1));
    expectMask(messageOf(encoding, pixels));
    if (pixels.channels() == 4) {  // opacity is not a colour
      cv::Mat opaque = pixels.clone();
      cv::insertChannel(cv::Mat(pixels.size(), CV_MAKETYPE(pixels.depth(), 1), cv::Scalar(255)),
                        opaque, 3);
      expectMask(messageOf(encoding, opaque));
    }
  }
  for (const double level : {1.0, 117.0, 30000.0, 65535.0}) {
    const cv::Mat white(kHeight, kWidth, CV_16UC1, cv::Scalar(level));
    EXPECT_EQ(cv::countNonZero(maskImage(messageOf("mono16", white))), kWidth * kHeight) << level;
  }
}

TEST(CompressedImages, KeepDepthColourAndBayerPattern) {
  const cv::Mat wide = sixteenBits(grey());
  const cv::Mat bgr = colour(40, 120, 200);
  const struct {
    const char* format;
    cv::Mat pixels;
    const char* encoding;
  } cases[] = {{"mono8; png compressed", grey(), "mono8"},
               {"png", grey(), "mono8"},
               {"bayer_rggb8; png compressed", grey(), "bayer_rggb8"},
               {"16UC1; png compressed", wide, "16UC1"},
               {"", wide, "mono16"},
               {"rgb8; png compressed bgr8", bgr, "bgr8"},
               {"bgra8; png compressed", withAlpha(bgr), "bgra8"}};
  for (const auto& [format, pixels, encoding] : cases) {
    SCOPED_TRACE(format);
    sensor_msgs::CompressedImage message;
    message.header.stamp.sec = 7;
    message.format = format;
    ASSERT_TRUE(cv::imencode(".png", pixels, message.data));
    const sensor_msgs::ImageConstPtr image = decodedImage(message);
    ASSERT_TRUE(image);
    EXPECT_EQ(image->header.stamp, message.header.stamp);
    EXPECT_EQ(image->encoding, encoding);
    const cv::Mat decoded(pixels.size(), pixels.type(), const_cast<uchar*>(image->data.data()),
                          image->step);
    EXPECT_EQ(cv::norm(decoded, pixels, cv::NORM_INF), 0.0);
    message.data.resize(message.data.size() / 8);
    expectRefused<RefusedImage>([&] { decodedImage(message); }, "it has no end");
    message.data.clear();
    expectRefused<RefusedImage>([&] { decodedImage(message); }, "has no data");
  }
}

sensor_msgs::CompressedImage compressed(const std::string& ending, const cv::Mat& pixels) {
  sensor_msgs::CompressedImage message;
  message.format = "test";
  cv::imencode(ending, pixels, message.data);
  return message;
}

// OpenCV decodes half a JPEG with grey in place of the rest.
TEST(CompressedImages, TruncatedOnesAreRefusedLikeFiles) {
  for (const char* ending : {".jpg", ".png"}) {
    sensor_msgs::CompressedImage message = compressed(ending, grey());
    EXPECT_NO_THROW(decodedImage(message));
    message.data.resize(message.data.size() * 3 / 5);
    expectRefused<RefusedImage>([&] { decodedImage(message); },
                                "compressed image (format \"test\") is damaged or cut off");
    const sensor_msgs::ImageConstPtr none =
        undecodedImage({}, RefusedImage("compressed image of a test"));
    for (const auto& use : std::vector<std::function<void()>>{
             [&] { greyImage(none); }, [&] { warpableImage(none); }, [&] { colourImage(none); }}) {
      EXPECT_EQ(refusalOf<RefusedImage>(use), "compressed image of a test");
    }
  }
}

sensor_msgs::CompressedImage jpeg(const cv::Mat& pixels, int restart_interval) {
  sensor_msgs::CompressedImage message;
  message.format = "jpeg";
  cv::imencode(".jpg", pixels, message.data,
               {cv::IMWRITE_JPEG_QUALITY, 90, cv::IMWRITE_JPEG_RST_INTERVAL, restart_interval});
  return message;
}

// As drivers of MJPEG cameras send them, which append the end to what has come. OpenCV gives no
// warning.
TEST(CompressedImages, LostDataAreNoticedAlthoughTheEndIsThere) {
  const cv::Mat texture = test::noiseImage({210, 150}, 3);
  cv::Mat colours;
  cv::merge(std::vector<cv::Mat>{texture, 255 - texture, texture}, colours);
  sensor_msgs::CompressedImage progressive;
  cv::imencode(".jpg", texture, progressive.data, {cv::IMWRITE_JPEG_PROGRESSIVE, 1});
  EXPECT_NO_THROW(decodedImage(progressive));
  for (const double share : {0.1, 0.5, 0.95}) {
    const auto middle = static_cast<std::ptrdiff_t>(share * progressive.data.size());
    sensor_msgs::CompressedImage cut = progressive;
    cut.data.erase(cut.data.begin() + middle, cut.data.end() - 2);
    expectRefused<RefusedImage>([&] { decodedImage(cut); }, "is damaged");
  }
  for (const cv::Mat& pixels : {texture, colours}) {
    for (const int interval : {0, 7}) {
      const sensor_msgs::CompressedImage whole = jpeg(pixels, interval);
      EXPECT_NO_THROW(decodedImage(whole));
      for (const double share : {0.4, 0.7, 0.95}) {
        const auto middle = static_cast<std::ptrdiff_t>(share * whole.data.size());
        sensor_msgs::CompressedImage cut = whole;
        cut.data.erase(cut.data.begin() + middle, cut.data.end() - 2);
        expectRefused<RefusedImage>([&] { decodedImage(cut); }, "is damaged: data are missing");
        sensor_msgs::CompressedImage hole = whole;
        hole.data.erase(hole.data.begin() + middle - 1500, hole.data.begin() + middle - 500);
        if (interval > 0) continue;  // a decoder goes on with the next part
        expectRefused<RefusedImage>([&] { decodedImage(hole); }, "is damaged: data are missing");
      }
    }
  }
}

TEST(CompressedImages, UniformGreyIsNotTakenForMissingData) {
  for (const int interval : {0, 5}) {
    for (const cv::Size size : {cv::Size(64, 48), cv::Size(67, 49), cv::Size(3, 2)}) {
      for (const int type : {CV_8UC1, CV_8UC3}) {
        const cv::Mat pixels(size, type, cv::Scalar::all(128));
        EXPECT_NO_THROW(decodedImage(jpeg(pixels, interval))) << size << type;
      }
    }
  }
  cv::Mat half = test::noiseImage({211, 147}, 4);
  half.rowRange(70, 147).setTo(128);
  EXPECT_NO_THROW(decodedImage(jpeg(half, 0)));
  std::vector<std::uint8_t> progressive;
  cv::imencode(".jpg", half, progressive, {cv::IMWRITE_JPEG_PROGRESSIVE, 1});
  sensor_msgs::CompressedImage message;
  message.data = progressive;
  EXPECT_NO_THROW(decodedImage(message));
}

// A large picture of one colour is small when compressed.
TEST(CompressedImages, AreBoundedBeforeTheyAreDecoded) {
  for (const char* ending : {".png", ".jpg", ".bmp", ".tiff", ".webp"}) {
    const sensor_msgs::CompressedImage small = compressed(ending, grey());
    const std::string_view bytes(reinterpret_cast<const char*>(small.data.data()),
                                 small.data.size());
    EXPECT_DOUBLE_EQ(files::megapixelsOf(bytes).value_or(0.0), 1e-6 * kWidth * kHeight) << ending;
    EXPECT_EQ(decodedImage(small)->width, static_cast<std::uint32_t>(kWidth)) << ending;
  }
  EXPECT_EQ(decodedImage(compressed(".png", cv::Mat::zeros(8000, 8000, CV_8UC1)))->width, 8000u);
  const cv::Mat large = cv::Mat::zeros(8000, 8001, CV_8UC1);
  for (const char* ending : {".png", ".bmp"}) {
    expectRefused<RefusedImage>([&] { decodedImage(compressed(ending, large)); },
                                "has 64.0 megapixels; expected 64 at most");
  }
  sensor_msgs::CompressedImage bomb = compressed(".png", grey());
  for (const std::size_t byte : {16, 20}) bomb.data[byte] = 0x7f;  // both sides beyond 2^30 px
  expectRefused<RefusedImage>([&] { decodedImage(bomb); }, "megapixels; expected 64 at most");
  expectRefused<RefusedImage>([&] { decodedImage(compressed(".ppm", colour(1, 2, 3))); },
                              "is no JPEG, PNG, TIFF, WebP or BMP");
}

TEST(CompressedImages, OfDepthLoseTheirHeader) {
  const cv::Mat wide = sixteenBits(grey());
  sensor_msgs::CompressedImage message = compressed(".png", wide);
  message.data.insert(message.data.begin(), 12, 0);
  message.format = "16UC1; compressedDepth png";
  const sensor_msgs::ImageConstPtr image = decodedImage(message);
  EXPECT_EQ(image->encoding, "16UC1");
  EXPECT_EQ(difference(greyImage(image, kAsTheyAre), grey()), 0.0);
  message.format = "32FC1; compressedDepth png";
  expectRefused<RefusedImage>([&] { decodedImage(message); }, "is depth in floats");
  message.format = "16UC1; compressedDepth rvl";
  message.data.assign(500, 7);
  expectRefused<RefusedImage>([&] { decodedImage(message); },
                              "(format \"16UC1; compressedDepth rvl\") is no JPEG");
}

TEST(YuvImages, KeepTheirColoursForViews) {
  cv::Mat planes(kHeight * 3 / 2, kWidth, CV_8UC1, cv::Scalar(90));
  for (const bool nv21 : {false, true}) {
    cv::Mat chroma(kHeight / 2, kWidth / 2, CV_8UC2,
                   nv21 ? cv::Scalar(200, 128) : cv::Scalar(128, 200));
    std::copy_n(chroma.data, chroma.total() * 2, planes.ptr(kHeight));
    auto message = messageOf(nv21 ? "nv21" : "nv12", planes);
    message->height = kHeight;
    for (const cv::Mat& picture : {colourImage(message), warpableImage(message)->image}) {
      ASSERT_EQ(picture.size(), cv::Size(kWidth, kHeight));
      const cv::Scalar mean = cv::mean(picture);
      EXPECT_GT(mean[2] - mean[0], 60.0) << message->encoding << " is red";
    }
    message->data.resize(kWidth * kHeight);
    EXPECT_EQ(warpableImage(message)->encoding, "mono8") << "without its colours";
  }
  cv::Mat red = yuyv();
  for (int x = 1; x < kWidth; x += 2) {
    for (int y = 0; y < kHeight; ++y) red.at<cv::Vec2b>(y, x)[1] = 220;
  }
  const cv::Scalar mean = cv::mean(colourImage(messageOf("yuv422_yuy2", red)));
  EXPECT_GT(mean[2] - mean[0], 60.0);
  const auto odd = messageOf("yuyv", red(cv::Rect(0, 0, kWidth - 1, kHeight)));
  expectRefused<RefusedImage>([&] { greyImage(odd); }, "expected an even one for yuyv");
}

/// Its right half is hidden, under other pixels.
cv::Mat halfHidden(const cv::Mat& pixels, int type) {
  cv::Mat out(pixels.size(), type, cv::Scalar::all(0));
  const double white = CV_MAT_DEPTH(type) == CV_8U ? 255.0 : 65535.0;
  cv::Mat wide;
  pixels.convertTo(wide, CV_MAT_DEPTH(type), white / 255.0);
  cv::merge(std::vector<cv::Mat>{wide, wide, wide, cv::Mat(wide.size(), wide.type(), white)}, out);
  cv::Mat opacity(wide.size(), wide.type(), cv::Scalar(white));
  opacity(cv::Rect(kWidth / 2, 0, kWidth / 2, kHeight)).setTo(0.0);
  cv::insertChannel(opacity, out, 3);
  return out;
}

TEST(Opacity, HiddenPixelsAreNotPartOfAnImage) {
  const cv::Mat noise = test::noiseImage({kWidth, kHeight}, 5);
  const cv::Rect seen(0, 0, kWidth / 2, kHeight),
      hidden(kWidth / 2 + 4, 0, kWidth / 2 - 4, kHeight);
  const auto roughness = [](const cv::Mat& part) {
    cv::Mat edges;
    cv::Laplacian(part, edges, CV_32F);
    return cv::norm(edges, cv::NORM_L1) / static_cast<double>(part.total());
  };
  for (const auto& [encoding, type] : std::map<std::string, int>{
           {"bgra8", CV_8UC4}, {"rgba8", CV_8UC4}, {"8UC4", CV_8UC4}, {"bgra16", CV_16UC4}}) {
    const cv::Mat found = greyImage(messageOf(encoding, halfHidden(noise, type)), kAsTheyAre);
    EXPECT_LE(cv::norm(found(seen), noise(seen), cv::NORM_INF), 1.0) << encoding;
    EXPECT_LT(roughness(found(hidden)), 0.1 * roughness(noise(hidden))) << encoding;
  }
  // Drivers leave it zero.
  cv::Mat zero = withAlpha(colour(40, 120, 200));
  cv::insertChannel(cv::Mat(zero.size(), CV_8UC1, cv::Scalar(0)), zero, 3);
  EXPECT_LE(difference(greyImage(messageOf("bgra8", zero)), expectedOfColour()), 2.0);
}

TEST(Opacity, OfAFileHidesInEveryReader) {
  const std::string path = ::testing::TempDir() + "ktgp_orb_opacity_test.png";
  const cv::Mat noise = test::noiseImage({kWidth, kHeight}, 5);
  const cv::Rect hidden(kWidth / 2 + 4, 0, kWidth / 2 - 4, kHeight);
  for (const int type : {CV_8UC4, CV_16UC4}) {
    ASSERT_TRUE(cv::imwrite(path, halfHidden(noise, type)));
    for (const cv::Mat& read : {files::readGrey(path), files::readForView(path),
                                greyImage(readImageFile("reference_image", path))}) {
      cv::Mat deviation, mean;
      cv::meanStdDev(read(hidden), mean, deviation);
      EXPECT_LT(deviation.at<double>(0), 15.0) << type;
    }
    EXPECT_EQ(cv::countNonZero(readMaskFile(path)(hidden)), 0) << "a mask hides there";
  }
  ASSERT_TRUE(cv::imwrite(path, cv::Mat(kHeight, kWidth, CV_8UC4, cv::Scalar(90, 80, 70, 0))));
  expectRefused<std::runtime_error>([&] { files::readGrey(path); }, "is transparent everywhere");
  std::remove(path.c_str());
}

TEST(Masks, ThatHideAllOrNothingAreNamed) {
  const std::string path = ::testing::TempDir() + "ktgp_orb_mask_test.png";
  for (const int type : {CV_8UC1, CV_16UC3}) {
    ASSERT_TRUE(cv::imwrite(path, cv::Mat::zeros(kHeight, kWidth, type)));
    expectRefused<RefusedImage>([&] { readMaskFile(path); }, "hides the whole image");
    ASSERT_TRUE(cv::imwrite(path, cv::Mat(kHeight, kWidth, type, cv::Scalar::all(1))));
    EXPECT_EQ(idleMask(readMaskFile(path)).rfind("hides nothing: only black (0)", 0), 0u);
  }
  EXPECT_EQ(idleMask({}), "");
  cv::Mat one(kHeight, kWidth, CV_8UC1, cv::Scalar(255));
  one.at<uchar>(3, 3) = 0;
  EXPECT_EQ(idleMask(one), "");
  std::remove(path.c_str());
}

TEST(ImageTopics, AreRectifiedByTheirNameWithoutTheTransport) {
  const std::map<std::string, bool> topics{{"/camera/image_rect", true},
                                           {"/camera/image_rect_color", true},
                                           {"/camera/image_rect_color/compressed", true},
                                           {"/camera/image_rect/compressedDepth", true},
                                           {"/camera/image_rect/theora", true},
                                           {"/camera/image_rect/relay", true},
                                           {"image_rect", true},
                                           {"/kinect2/hd/image_color_rect", true},
                                           {"/kinect2/hd/image_mono_rect/compressed", true},
                                           {"/camera/infra1/image_rect_raw", true},
                                           {"/camera/rectified/image", true},
                                           {"/camera/rectified/image_mono/compressed", true},
                                           {"/camera/rectified/image_raw", false},
                                           {"/camera/image_direct", false},
                                           {"/camera/rectangles/image", false},
                                           {"image_rect/compressed", true},
                                           {"/camera/image_raw", false},
                                           {"/camera/image_raw/compressed", false},
                                           {"/image_rect/image_raw", false},
                                           {"/camera/image_color", false},
                                           {"/rect/front", false},
                                           {"/", false},
                                           {"", false}};
  for (const auto& [topic, is_rectified] : topics) {
    EXPECT_EQ(pixelsFrom("by_name", topic) == Pixels::rectified, is_rectified) << topic;
    EXPECT_EQ(pixelsFrom("raw", topic), Pixels::raw);
    EXPECT_EQ(pixelsFrom("rectified", topic), Pixels::rectified);
  }
  EXPECT_EQ(pixelsOf("/resize/image"), std::nullopt) << "as if by any resizer";
  EXPECT_EQ(rawTopic("/camera/image_raw/compressedDepth"), "/camera/image_raw");
  EXPECT_EQ(rawTopic("/camera/image_raw"), "/camera/image_raw");
}

TEST(Masks, FileMasksOfEveryDepthAreAccepted) {
  const std::string path = ::testing::TempDir() + "ktgp_orb_mask_test.png";
  const cv::Rect right(kWidth / 2, 0, kWidth / 2, kHeight);
  for (const int type : {CV_8UC1, CV_16UC1, CV_8UC3, CV_16UC3, CV_16UC4}) {
    cv::Mat mask(kHeight, kWidth, type, cv::Scalar(0, 0, 0, 255));
    mask(right).setTo(cv::Scalar(1, 0, 0, 255));  // blue alone, of the darkest
    ASSERT_TRUE(cv::imwrite(path, mask));
    const cv::Mat read = readMaskFile(path);
    EXPECT_EQ(cv::countNonZero(read), right.area()) << type;
    EXPECT_EQ(cv::countNonZero(read(right)), right.area()) << type;
  }
  std::remove(path.c_str());
}

// The used part of a camera's images: masks, region of interest, lens, and rate.

sensor_msgs::ImageConstPtr image(int width, int height) {
  return messageOf("mono8", test::flatImage({width, height}, 7));
}

TEST(Roi, IsReadFromFourNumbers) {
  EXPECT_EQ(roiFrom("10 20 30 40"), cv::Rect(10, 20, 30, 40));
  EXPECT_EQ(roiFrom(" 10, 20,30 ,40 "), cv::Rect(10, 20, 30, 40));
  EXPECT_TRUE(roiFrom("").empty());
  EXPECT_TRUE(roiFrom("  ").empty());
}

TEST(Roi, RefusesAnythingElse) {
  for (const char* text : {"10 20 30", "10 20 30 40 50", "a b c d", "-1 0 10 10", "0 0 0 10",
                           "0 0 10 -1", "0.5 0 10 10", "0 0 10 10px", "nan nan nan nan"}) {
    expectRefused([&] { roiFrom(text); },
                  "roi is '" + std::string(text) + "'; expected x y width height");
  }
}

TEST(FrameMaker, MasksAreCombinedByAnd) {
  CameraView view;
  view.roi = {10, 10, 100, 20};  // beyond the right edge
  view.file_mask = cv::Mat::zeros(40, 60, CV_8UC1);
  view.file_mask(cv::Rect(0, 0, 30, 40)).setTo(1);
  view.sent_mask = cv::Mat(40, 60, CV_8UC1, cv::Scalar(200));
  view.sent_mask(cv::Rect(12, 12, 4, 4)).setTo(0);
  FrameMaker maker({}, view);
  Frame frame;
  maker.make(image(60, 40), frame);
  cv::Mat expected = cv::Mat::zeros(40, 60, CV_8UC1);
  expected(cv::Rect(10, 10, 20, 20)).setTo(255);
  expected(cv::Rect(12, 12, 4, 4)).setTo(0);
  ASSERT_EQ(frame.mask.size(), expected.size());
  EXPECT_EQ(cv::countNonZero(frame.mask != expected), 0);
  const cv::Mat first = frame.mask;
  maker.make(image(60, 40), frame);
  EXPECT_EQ(frame.mask.data, first.data) << "made once";
}

TEST(FrameMaker, WithoutAnyThereIsNoMask) {
  FrameMaker maker({}, {});
  Frame frame;
  maker.make(image(60, 40), frame);
  EXPECT_TRUE(frame.mask.empty());
  EXPECT_EQ(frame.image.size(), cv::Size(60, 40));
}

TEST(FrameMaker, RefusesAMaskOfAnotherSizeAndARoiOutside) {
  CameraView view;
  view.file_mask = cv::Mat(40, 61, CV_8UC1, cv::Scalar(1));
  Frame frame;
  const auto refusal = [&] {
    return refusalOf<RefusedImage>([&] { FrameMaker({}, view).make(image(60, 40), frame); });
  };
  EXPECT_EQ(refusal(), "mask_image is 61x40; expected 60x40 like the image");
  view.file_mask.release();
  view.sent_mask = cv::Mat(41, 60, CV_8UC1, cv::Scalar(1));
  EXPECT_EQ(refusal(), "the image on ~mask is 60x41; expected 60x40 like the image");
  view.sent_mask.release();
  view.roi = {60, 0, 10, 10};
  EXPECT_EQ(refusal(), "roi is outside of the image of 60x40");
}

TEST(FrameMaker, AnEmptyMessageIsNoMask) {
  EXPECT_TRUE(maskFrom(image(0, 0)).empty());
  EXPECT_EQ(maskFrom(image(8, 4)).size(), cv::Size(8, 4));
}

sensor_msgs::CameraInfo calibrated() {
  sensor_msgs::CameraInfo info;
  info.width = 640;
  info.height = 480;
  info.distortion_model = "plumb_bob";
  info.D = {-0.2, 0.05, 0.0, 0.0, 0.0};
  info.K = {500.0, 0.0, 320.0, 0.0, 510.0, 240.0, 0.0, 0.0, 1.0};
  info.R = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};
  info.P = {450.0, 0.0, 322.0, 0.0, 0.0, 460.0, 242.0, 0.0, 0.0, 0.0, 1.0, 0.0};
  return info;
}

TEST(MatcherOverlay, HasTheColoursOfTheCamera) {
  cv::Mat grey = test::noiseImage({320, 240}, 1);
  cv::GaussianBlur(grey, grey, {}, 2.0);
  const cv::Mat dark = 0.2 * grey;
  cv::Mat red;
  cv::merge(std::vector<cv::Mat>{dark, dark, grey}, red);
  for (const OverlayStyle style : {OverlayStyle::flow, OverlayStyle::side_by_side}) {
    Configuration configuration = configurationFrom(Parameters(), 0);
    configuration.overlay_style = style;
    MessageMatcher matcher(configuration);
    for (int i = 0; i < 2; ++i) {
      const sensor_msgs::ImagePtr message = toImage({}, "bgr8", red);
      message->header.stamp = ros::Time(1 + i);
      message->header.frame_id = "camera";
      matcher.process(message);
      const sensor_msgs::ImageConstPtr overlay = matcher.overlay(message);
      EXPECT_EQ(overlay->header.stamp, message->header.stamp);
      EXPECT_EQ(overlay->header.frame_id, "camera");
      const cv::Mat picture = cv_bridge::toCvShare(overlay)->image;
      const cv::Scalar mean =
          cv::mean(picture(cv::Rect(picture.cols - 40, picture.rows - 40, 40, 40)));
      EXPECT_GT(mean[2], mean[0] + 10.0) << toString(style) << i;
    }
  }
  MessageMatcher matcher(configurationFrom(Parameters(), 0));
  cv::Mat deep;
  red.convertTo(deep, CV_16U, 16.0);
  const sensor_msgs::ImageConstPtr message = toImage({}, "bgr16", deep);
  matcher.process(message);
  EXPECT_GT(cv::mean(cv_bridge::toCvShare(matcher.overlay(message))->image)[0], 40.0)
      << "12 bits are stretched";
}

TEST(MatcherOverlay, IsDrawnForEveryEncodingThatIsTaken) {
  for (const auto& [name, expected] : taken()) {
    MessageMatcher matcher(configurationFrom(Parameters(), 0));
    const auto message = messageOf(name, expected.pixels);
    matcher.process(message);
    const cv::Mat picture = cv_bridge::toCvShare(matcher.overlay(message))->image;
    ASSERT_EQ(picture.size(), cv::Size(kWidth, kHeight)) << name;
    cv::Mat grey;
    cv::cvtColor(picture, grey, cv::COLOR_BGR2GRAY);
    const cv::Rect corner(kWidth - 20, kHeight - 20, 16, 16);  // without words and points
    EXPECT_LT(std::abs(cv::mean(grey(corner))[0] - cv::mean(expected.grey(corner))[0]), 80.0)
        << name;
  }
}

// Or motion in metres would take K for P.
TEST(MessageMatcher, SaysThatTheImagesAreRectifiedAlready) {
  for (const Pixels pixels : {Pixels::raw, Pixels::rectified}) {
    Configuration configuration = configurationFrom(Parameters(), 0);
    configuration.view.pixels = pixels;
    MessageMatcher matcher(configuration);
    const auto message = messageOf("mono8", test::noiseImage({320, 240}, 1));
    matcher.process(message);
    message->header.stamp = ros::Time(1);
    message->data[0] ^= 1;
    const MatchedFrame frame = matcher.process(message);
    const bool is_rectified = pixels == Pixels::rectified;
    EXPECT_EQ(toHomography(frame)->rectified != 0, is_rectified);
    ASSERT_NE(toCorrespondences(frame), nullptr);
    EXPECT_EQ(toCorrespondences(frame)->rectified != 0, is_rectified);
  }
}

// Other options find its features anew, in another frame of the same image.
TEST(MessageMatcher, AConfiguredReferenceStaysOneWithOtherOptions) {
  const cv::Mat grey = test::noiseImage({320, 240}, 1);
  const sensor_msgs::ImagePtr seen = toImage({}, "mono8", grey);
  Parameters parameters;
  parameters.reference_mode = "fixed";
  Configuration configuration = configurationFrom(parameters, 0);
  configuration.reference_image = seen;
  MessageMatcher matcher(configuration);
  for (const int features : {500, 1000}) {
    parameters.features = features;
    configuration.sequence = configurationFrom(parameters, 0).sequence;
    matcher.configure(configuration);
    matcher.process(seen);
    EXPECT_FALSE(matcher.holdsSetReference()) << features;
  }
  matcher.fixNextFrame();
  matcher.process(toImage({}, "mono8", grey));
  EXPECT_TRUE(matcher.holdsSetReference());
}

TEST(Lens, EqualsCameraInfo) {
  const LensCalibration c = lensFrom(calibrated())->calibration();
  EXPECT_EQ(c.image_size, cv::Size(640, 480));
  EXPECT_EQ(c.camera(1, 1), 510.0);
  EXPECT_EQ(c.rectified_camera(0, 2), 322.0);
  EXPECT_EQ(c.distortion.size(), 5U);
}

TEST(Lens, SecondCameraIsTurnedByRectification) {
  sensor_msgs::CameraInfo info = calibrated();
  const double c = std::cos(0.05), s = std::sin(0.05);
  info.R = {c, 0.0, s, 0.0, 1.0, 0.0, -s, 0.0, c};
  const LensCalibration turned = lensFrom(info)->calibration();
  EXPECT_EQ(turned.rotation, cv::Matx33d(info.R.data()));
  info.R.fill(0.0);  // a camera_info without rotation
  EXPECT_EQ(lensFrom(info)->calibration().rotation, cv::Matx33d::eye());
}

// A 400x300 part of the sensor, read out at half size: the centre (320, 240) of the sensor is
// at ((320 - 100) / 2, (240 - 60) / 2) of the image.
TEST(Lens, KnowsBinningAndThePartOfTheSensor) {
  sensor_msgs::CameraInfo info = calibrated();
  info.binning_x = info.binning_y = 2;
  info.roi.x_offset = 100;
  info.roi.y_offset = 60;
  info.roi.width = 400;
  info.roi.height = 300;
  const LensCalibration c = lensFrom(info)->calibration();
  EXPECT_EQ(c.image_size, cv::Size(200, 150));
  EXPECT_EQ(c.camera, cv::Matx33d(250.0, 0.0, 110.0, 0.0, 255.0, 90.0, 0.0, 0.0, 1.0));
  EXPECT_EQ(c.rectified_camera(0, 2), 111.0);
}

TEST(Lens, UncalibratedCameraIsRefused) {
  expectRefused([] { lensFrom(sensor_msgs::CameraInfo()); }, "not calibrated");
  sensor_msgs::CameraInfo info = calibrated();
  info.distortion_model = "mei";
  expectRefused([&] { lensFrom(info); }, "'mei'; expected");
}

TEST(Lens, ZerosOfAnUnknownModelMayStillDistort) {
  sensor_msgs::CameraInfo info = calibrated();
  const cv::Size size = imageSize(info);
  info.D.assign(4, 0.0);
  for (const char* name : {"fisheye", "mei"}) {
    info.distortion_model = name;
    expectRefused([&] { pixelCamera(info, Pixels::raw, size); }, "expected plumb_bob");
    EXPECT_NO_THROW(pixelCamera(info, Pixels::rectified, size));
  }
  for (const char* name : {"", "none", "pinhole"}) {
    info.distortion_model = name;
    EXPECT_NO_THROW(pixelCamera(info, Pixels::raw, size)) << name;
  }
}

TEST(Lens, ImpossibleCalibrationIsRefused) {
  using Change = std::function<void(sensor_msgs::CameraInfo&)>;
  const std::vector<std::pair<std::string, Change>> changes{
      {"camera matrix has skew, 40.0", [](auto& i) { i.K[1] = 40.0; }},
      {"rectified camera matrix has skew, 40.0", [](auto& i) { i.P[1] = 40.0; }},
      {"the camera matrix is not upper triangular", [](auto& i) { i.K[6] = 0.1; }},
      {"the rectifying rotation is no rotation matrix", [](auto& i) { i.R[8] = -1.0; }},
      {"the rectifying rotation is no rotation matrix", [](auto& i) { i.R[1] = 0.1; }},
      {"fx of the camera matrix is 1e-10; expected", [](auto& i) { i.K[0] = 1e-10; }},
      {"fx of the camera matrix is 1e+300; expected", [](auto& i) { i.K[0] = 1e300; }},
      {"fy of the rectified camera matrix is 1e+12", [](auto& i) { i.P[5] = 1e12; }},
      {"fx of the camera matrix is 1; expected a focal length in [96, 32000] px",
       [](auto& i) { i.K[0] = 1.0; }},
      {"fx of the camera matrix is 100000; expected", [](auto& i) { i.K[0] = 1e5; }},
      {"K of the camera_info has its principal point at 960, 240, outside the image of 640x480 px",
       [](auto& i) { i.K[2] = 960.0; }}};
  for (const auto& [words, change] : changes) {
    sensor_msgs::CameraInfo info = calibrated();
    change(info);
    expectRefused([&] { lensFrom(info); }, words);
  }
}

TEST(Lens, OtherImageSizeIsNotUsed) {
  CameraView view;
  view.lens = lensFrom(calibrated());
  FrameMaker maker({}, view);
  Frame frame;
  maker.make(image(640, 480), frame);
  EXPECT_EQ(frame.lens, view.lens);
  maker.make(image(320, 240), frame);
  EXPECT_EQ(frame.lens, nullptr);
}

/// Numbers of the frames of `rate` Hz that are used of the first `count`; each stamp is off by up
/// to `shake` of the time between two frames.
std::vector<int> taken(double rate, double max_rate, int count, double shake = 0.0) {
  RateLimiter limiter;
  limiter.setRate(max_rate);
  std::vector<int> numbers;
  std::srand(1);
  for (int i = 0; i < count; ++i) {
    const double off = shake * (2.0 * std::rand() / RAND_MAX - 1.0);
    if (limiter.takes(ros::Time(1000.0 + (i + off) / rate))) numbers.push_back(i);
  }
  return numbers;
}

TEST(RateLimiter, SkipsEvenly) {
  const std::vector<std::pair<double, double>> cases{
      {30.0, 20.0}, {60.0, 7.0}, {30.0, 29.0}, {25.0, 0.5}};
  for (const auto& [rate, limit] : cases) {
    const std::vector<int> numbers = taken(rate, limit, 3000);
    EXPECT_NEAR(double(numbers.size()), 3000.0 * limit / rate, 1.5) << rate << " " << limit;
    const int step = static_cast<int>(rate / limit);
    for (std::size_t i = 2; i < numbers.size(); ++i) {  // the first slot is half a slot
      const int gap = numbers[i] - numbers[i - 1];
      EXPECT_TRUE(gap == step || gap == step + 1) << rate << " to " << limit << ": " << gap;
    }
  }
}

TEST(RateLimiter, JitterAtTheLimitLosesNothing) {
  EXPECT_EQ(taken(30.0, 30.0, 3000, 0.2).size(), 3000U);
  EXPECT_EQ(taken(10.0, 30.0, 300, 0.4).size(), 300U);
}

TEST(RateLimiter, ZeroTakesAllAndAStampThatGoesBackBeginsAnew) {
  EXPECT_EQ(taken(1000.0, 0.0, 500).size(), 500U);
  RateLimiter limiter;
  limiter.setRate(1.0);
  EXPECT_TRUE(limiter.takes(ros::Time(100.0)));
  EXPECT_FALSE(limiter.takes(ros::Time(100.1)));
  EXPECT_TRUE(limiter.takes(ros::Time(50.0)));
  EXPECT_FALSE(limiter.takes(ros::Time(50.1)));
  limiter.setRate(2.0);
  EXPECT_TRUE(limiter.takes(ros::Time(50.2)));
}

TEST(Messages, AccumulatedPlaneDeviationIsTheLargestOfTheChain) {
  SequenceMatch match;
  const auto frame = std::make_shared<Frame>();
  match.frame = match.reference = frame;
  match.match.answer.plane_deviation = 1.0;  // of the last frame
  match.accumulated.emplace();
  match.accumulated->plane_deviation = 2.0;
  const auto message = toAccumulated({{}, match});
  ASSERT_TRUE(message);
  EXPECT_EQ(message->plane_deviation, 2.0);
}

}  // namespace
}  // namespace ktgp_orb
