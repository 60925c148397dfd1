// Conversion of every encoding of sensor_msgs. No ROS master is needed.
#include "messages/image_conversion.h"

#include <gtest/gtest.h>
#include <sensor_msgs/image_encodings.h>
#include <sys/stat.h>

#include <boost/make_shared.hpp>
#include <fstream>
#include <functional>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <regex>
#include <set>
#include <string>

#include "files/input.h"
#include "refusal.h"

namespace ktgp_orb {
namespace {

using test::refusalOf;
using util::GreyStretch;

constexpr int kWidth = 64;
constexpr int kHeight = 48;

/// A smooth picture, so that Bayer patterns can be interpolated.
cv::Mat grey() {
  cv::Mat image(kHeight, kWidth, CV_8UC1);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) image.at<uchar>(y, x) = static_cast<uchar>(3 * x + y);
  }
  return image;
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
  cv::Mat out = grey() / 8 + 120;
  for (int row = 0; row < kHeight; ++row) {
    for (int column = 0; column < kWidth; ++column) {
      auto& pixel = out.at<uchar>(row, column);
      if (row % 2 == y && column % 2 == x) pixel = static_cast<uchar>(pixel + 80);
      if (row % 2 != y && column % 2 != x) pixel = static_cast<uchar>(pixel - 80);
    }
  }
  return out;
}

cv::Mat uyvy() {
  cv::Mat out;
  cv::merge(std::vector<cv::Mat>{cv::Mat(kHeight, kWidth, CV_8U, cv::Scalar(128)), grey()}, out);
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
  all["yuv422"] = {uyvy(), grey()};
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

TEST(Encodings, TakenOnesBecomeTheirGrey) {
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
  names.insert({"", "no such encoding", "yuv422_yuy2", "jpeg"});
  for (const std::string& name : names) {
    const auto message = messageOf(name, cv::Mat::zeros(kHeight, kWidth, CV_64FC4));
    const std::string text = refusalOf<RefusedImage>([&] { greyImage(message); });
    EXPECT_NE(text.find("'" + name + "'"), std::string::npos) << text;
    EXPECT_NE(text.find("expected"), std::string::npos) << text;
  }
}

TEST(Encodings, OfSixteenBitsInEitherOrderOfBytes) {
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

TEST(Sizes, ThatDoNotFitAreRefused) {
  using Change = std::function<void(sensor_msgs::Image&)>;
  const std::map<std::string, Change> changes{
      {"step is 63; expected at least 64", [](auto& m) { m.step = 63; }},
      {"image is empty (0x48)", [](auto& m) { m.width = 0; }},
      {"data has 100 bytes; expected at least 3072", [](auto& m) { m.data.resize(100); }}};
  for (const auto& [text, change] : changes) {
    const auto message = messageOf("mono8", grey());
    change(*message);
    const std::string said = refusalOf<RefusedImage>([&] { greyImage(message); });
    EXPECT_NE(said.find(text), std::string::npos) << text << " | " << said;
  }
  const auto odd = messageOf("mono16", sixteenBits(grey()), 1);
  EXPECT_THROW(greyImage(odd), RefusedImage);
}

TEST(Sizes, OfARequestAreBoundedOneByOneAndTogether) {
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
  EXPECT_NE(refusalOf<RefusedImage>([&] {
              requireSmall("the image", image);
            }).find("the image is 8001x8000"),
            std::string::npos);
  images.assign(65, sensor_msgs::Image());
  EXPECT_NE(refusalOf<RefusedImage>([&] {
              requireSmall("the images", images);
            }).find("the images are 65 with 0 megapixels"),
            std::string::npos);
  images.resize(64);
  EXPECT_NO_THROW(requireSmall("the images", images));
}

TEST(Files, OfSixteenBitsAreConvertedAsMessagesAre) {
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
TEST(Files, OfFloatsAreRefusedWithTheSameWordsEverywhere) {
  for (const int type : {CV_32FC1, CV_32FC3, CV_64FC1}) {
    const std::string path = ::testing::TempDir() + "ktgp_orb_image_conversion_float.tiff";
    ASSERT_TRUE(cv::imwrite(path, cv::Mat(48, 64, type, cv::Scalar::all(0.5))));
    const std::vector<std::function<void()>> readers{
        [&] { files::readGrey(path); }, [&] { readImageFile("reference_image", path); },
        [&] { readMaskFile(path); }};
    for (const auto& read : readers) {
      const std::string depth = CV_MAT_DEPTH(type) == CV_32F ? "CV_32F" : "CV_64F";
      const std::string words =
          "has " + depth + " pixels; expected a picture of 8 or 16 bits a channel";
      const std::string said = refusalOf<std::runtime_error>(read);
      EXPECT_NE(said.find(words), std::string::npos) << said;
    }
    std::remove(path.c_str());
  }
}

// Opening a pipe would block until it has a writer.
TEST(Files, ThatAreNoRegularFilesAreRefusedAtOnce) {
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
    EXPECT_NO_THROW(decodedImage(message));
    message.data.clear();
    EXPECT_FALSE(decodedImage(message));
  }
}

TEST(Masks, OfAFileAreTakenAtEveryDepth) {
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

}  // namespace
}  // namespace ktgp_orb
