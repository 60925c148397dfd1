#pragma once

#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>

#include <opencv2/core.hpp>
#include <optional>
#include <string>

#include "ktgp_orb/sequence_matcher.h"
#include "ros/camera.h"
#include "ros/image_conversion.h"
#include "util/grey_levels.h"
#include "util/pool.h"

namespace ktgp_orb {

/// What a FrameMaker needs to know about a camera: which part of the images to use, the lens and
/// the calibration.
struct CameraView {
  cv::Rect roi;       ///< used part of the image, px; empty: the whole image
  cv::Mat file_mask;  ///< CV_8UC1, from the file mask_image; empty: none
  cv::Mat sent_mask;  ///< CV_8UC1, from the topic ~mask; empty: none
  LensConstPtr lens;  ///< rectifies keypoints; null: keypoints stay in raw pixels
  /// Calibration for the two-view geometry; null: unknown.
  sensor_msgs::CameraInfoConstPtr camera;
  Pixels pixels = Pixels::raw;  ///< whether the images are raw or rectified
};

/// Parses "x y width height", separated by blanks or commas, in px. Returns an empty rectangle for
/// an empty text. Throws std::invalid_argument for anything else.
cv::Rect roiFrom(const std::string& text);

/// Converts a message to a mask (see maskImage); the mask is empty if the message has no pixels.
/// Throws RefusedImage.
cv::Mat maskFrom(const sensor_msgs::ImageConstPtr& message);

/// Creates frames from a camera's images. Not thread-safe: only one thread may use an instance at a
/// time.
class FrameMaker {
 public:
  FrameMaker(util::GreyStretch stretch, const CameraView& view) : stretch_(stretch), view_(view) {}

  /// Sets `frame` to the image of the message, without features. Throws RefusedImage if greyImage()
  /// does, if a mask has another size than the image, or if the roi does not lie inside the image.
  void make(const sensor_msgs::ImageConstPtr& message, Frame& frame);

 private:
  const cv::Mat& maskOf(const cv::Size& size);
  void setCamera(Frame& frame);

  util::GreyStretch stretch_;
  CameraView view_;
  // Memory of earlier frames. We use it again, so that nothing is allocated after the first images.
  util::Pool<PixelMemory> memory_{8, [](PixelMemory& memory) { memory.message.reset(); }};
  std::optional<PixelCamera> camera_;  // camera for images of the size `camera_size_`
  cv::Size camera_size_;
  cv::Mat mask_;  // all masks of view_ combined, for images of the size of mask_
};

}  // namespace ktgp_orb
