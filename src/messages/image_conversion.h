#pragma once

#include <sensor_msgs/Image.h>

#include <opencv2/core.hpp>
#include <stdexcept>
#include <string>

#include "core/util/grey_levels.h"
#include "ktgp_orb/sequence_matcher.h"
#include "messages/pixel_memory.h"

namespace ktgp_orb {

/// An image message that cannot be used; what() says what is wrong and what would be right.
class RefusedImage : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// The image as 8-bit grey (CV_8UC1). A mono8 image is not copied: the result refers to the
/// message's own data and is valid while `message` lives. Colour and Bayer images are converted;
/// 16-bit ones are converted, then stretched. Throws RefusedImage for an empty image, a step or
/// amount of data that does not fit the size, and an encoding that is neither grey, colour, yuv422
/// nor Bayer; more data than the size needs is legal.
cv::Mat greyImage(const sensor_msgs::ImageConstPtr& message, const util::GreyStretch& stretch = {});
/// The same; colour and Bayer images are converted into `buffer`, in the memory it has where they
/// fit.
cv::Mat greyImage(const sensor_msgs::ImageConstPtr& message, const util::GreyStretch& stretch,
                  cv::Mat& buffer);

/// Makes `frame` the image of the message, without features. A mono8 image is held by its message,
/// so that inside one nodelet manager no pixel is ever copied. Throws as greyImage does.
void toFrame(const sensor_msgs::ImageConstPtr& message, const util::GreyStretch& stretch,
             Frame& frame);
/// The same, in memory that nobody else holds; the frame does from now on.
void toFrame(const sensor_msgs::ImageConstPtr& message, const util::GreyStretch& stretch,
             const std::shared_ptr<PixelMemory>& memory, Frame& frame);

/// A frame of the image with its features.
FramePtr makeFrame(const sensor_msgs::ImageConstPtr& message, OrbExtractor& extractor,
                   const util::GreyStretch& stretch = {});

/// CV_8UC1: 0 where the image is black, 255 everywhere else. Takes the encodings that greyImage
/// takes; a Bayer pixel counts by itself, a yuv422 one by its brightness. Throws RefusedImage.
cv::Mat maskImage(const sensor_msgs::ImageConstPtr& message);
/// The same of pixels in memory; of four channels the last one, the opacity, does not count.
cv::Mat notBlack(const cv::Mat& image);

/// The mask in an image file of any depth; empty for an empty path. Throws as readImageFile.
cv::Mat readMaskFile(const std::string& path);

/// An image file as a mono8 message, mono16 where the file has 16 bits, with stamp zero; null for
/// an empty path. Throws RefusedImage, which begins with `name`, for a file that cannot be read,
/// and for what is no regular file: a pipe would be waited for.
sensor_msgs::ImageConstPtr readImageFile(const std::string& name, const std::string& path);

}  // namespace ktgp_orb
