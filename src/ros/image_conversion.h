#pragma once

#include <cv_bridge/cv_bridge.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>

#include <Eigen/Core>
#include <memory>
#include <opencv2/core.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "ktgp_orb/sequence_matcher.h"
#include "util/grey_levels.h"

namespace ktgp_orb {

/// An image message that cannot be used; what() gives the reason and what is expected.
class RefusedImage : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

inline cv::Size sizeOf(const sensor_msgs::Image& image) {
  return {static_cast<int>(image.width), static_cast<int>(image.height)};
}

/// Throws RefusedImage with the reason if the image has no pixels, as those of undecodedImage().
void requirePixels(const sensor_msgs::Image& image);

/// Throws RefusedImage if the image of a service request has more than 64 megapixels, because one
/// request must not need unlimited memory and time.
void requireSmall(const std::string& name, const sensor_msgs::Image& image);
/// Throws RefusedImage for more than 64 images, or if the images have more than 64 megapixels in
/// total.
void requireSmall(const std::string& name, const std::vector<sensor_msgs::Image>& images);

/// The image as 8-bit grey (CV_8UC1). A mono8 image is not copied: the result refers to the
/// message's data and is valid while `message` lives. Colour and Bayer images are converted; 16-bit
/// images are then stretched to 8 bits. Throws RefusedImage for an empty image, if the step or the
/// amount of data does not fit the image size, and for an encoding that is not grey, colour,
/// yuv422, nv12 or Bayer. More data than needed is allowed. Transparent pixels are replaced so that
/// they contain no features (see util::fillHidden).
cv::Mat greyImage(const sensor_msgs::ImageConstPtr& message,
                  util::GreyStretch stretch = util::GreyStretch::percentile);
/// Like greyImage() above, but writes converted images to `buffer`, whose memory is used again.
cv::Mat greyImage(const sensor_msgs::ImageConstPtr& message, util::GreyStretch stretch,
                  cv::Mat& buffer);

/// The image in an encoding whose pixels can be interpolated: Bayer and YUV are converted to bgr8,
/// other encodings stay unchanged. The pixels are in the byte order of this machine, and valid
/// while `message` lives. Throws RefusedImage like greyImage().
cv_bridge::CvImageConstPtr warpableImage(const sensor_msgs::ImageConstPtr& message);

/// Returns true if the encoding has 8 bits per channel. Throws RefusedImage for an unknown
/// encoding. We do not use bitDepth() of sensor_msgs, because it does not know yuv422_yuy2, nv12
/// and similar encodings.
bool hasBytes(const std::string& encoding);

/// The image as CV_8UC3 (BGR), or CV_8UC1 for grey images; 16-bit grey is stretched to 8 bits. The
/// result is valid while `message` lives. Throws RefusedImage like greyImage().
cv::Mat colourImage(const sensor_msgs::ImageConstPtr& message);

/// Applies `warp`, a homography from a stabilizer, and keeps the size of the image. Where the
/// result lies outside of the warped image, repeats the nearest border pixel.
cv::Mat warped(const cv::Mat& image, const Eigen::Matrix3d& warp);

/// Decodes a compressed image and keeps its header. The encoding is mono8, mono16, bgr8, bgra8,
/// bgr16, bgra16, or the Bayer pattern at the beginning of the message's format. Also decodes
/// compressedDepth (16UC1). Throws RefusedImage for data that is not an image or is cut off, and,
/// before it decodes the data, for more than 64 megapixels.
sensor_msgs::ImageConstPtr decodedImage(const sensor_msgs::CompressedImage& message);
/// An image without pixels that stands for data that could not be decoded: greyImage() and
/// warpableImage() refuse it with the given reason.
sensor_msgs::ImageConstPtr undecodedImage(const std_msgs::Header& header,
                                          const RefusedImage& reason);

/// Owns the pixels of a frame: either the message, or a matrix with the converted pixels.
struct PixelMemory {
  sensor_msgs::ImageConstPtr message;
  cv::Mat grey;
};

/// Sets `frame` to the image of the message, without features. If the message is mono8, the frame
/// refers to the message's pixels, so that nothing is copied between nodelets of one manager.
/// Throws like greyImage().
void toFrame(const sensor_msgs::ImageConstPtr& message, util::GreyStretch stretch, Frame& frame);
/// Like toFrame() above, but keeps the pixels in `memory`.
void toFrame(const sensor_msgs::ImageConstPtr& message, util::GreyStretch stretch,
             const std::shared_ptr<PixelMemory>& memory, Frame& frame);

/// Makes a frame from the image and extracts its features.
FramePtr makeFrame(const sensor_msgs::ImageConstPtr& message, OrbExtractor& extractor,
                   util::GreyStretch stretch = util::GreyStretch::percentile);

/// A mask (CV_8UC1) that is 0 where the image is black and 255 elsewhere. Accepts the encodings of
/// greyImage. In Bayer images, a pixel is black if its raw value is 0; in yuv422 images, if its
/// brightness is 0. Throws RefusedImage.
cv::Mat maskImage(const sensor_msgs::ImageConstPtr& message);
/// Like maskImage(), for pixels in memory. A fourth channel is the opacity: the mask is also 0
/// where a pixel is transparent.
cv::Mat notBlack(const cv::Mat& image);

/// Reads a mask from an image file of any depth; empty for an empty path. Throws like
/// readImageFile, and also if the mask hides the whole image.
cv::Mat readMaskFile(const std::string& path);
/// Returns true if the mask hides the whole image. An empty mask hides nothing.
bool hidesAll(const cv::Mat& mask);
constexpr char kHidesAll[] =
    "hides the whole image, since black and transparent pixels hide; expected white where the "
    "image is looked at";
/// Returns a warning if the mask hides nothing. Returns an empty text if it hides something, and
/// for an empty mask.
std::string idleMask(const cv::Mat& mask);

/// Reads an image file as a message with stamp zero: mono16 if the file has 16 bits, else mono8.
/// Returns null for an empty path. Throws RefusedImage, with a text that begins with `name`, if the
/// file cannot be read or is not a regular file, because reading a pipe could block.
sensor_msgs::ImageConstPtr readImageFile(const std::string& name, const std::string& path);

}  // namespace ktgp_orb
