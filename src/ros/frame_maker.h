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

/// What a FrameMaker needs to know about a camera: the used part of the images, the lens and the
/// calibration.
struct CameraView {
  cv::Rect roi;       ///< px; empty: the whole image
  cv::Mat file_mask;  ///< CV_8UC1, from mask_image; empty: none
  cv::Mat sent_mask;  ///< CV_8UC1, from ~mask; empty: none
  LensConstPtr lens;  ///< null: points stay in the pixels of the raw image
  /// Calibration for the two-view geometry; null: not known.
  sensor_msgs::CameraInfoConstPtr camera;
  Pixels pixels = Pixels::raw;  ///< kind of the images of `camera`
};

/// Parses "x y width height", separated by blanks or commas; an empty rectangle for an empty text.
/// Throws std::invalid_argument for anything else.
cv::Rect roiFrom(const std::string& text);

/// The mask in a message (see maskImage); empty for an image without pixels. Throws RefusedImage.
cv::Mat maskFrom(const sensor_msgs::ImageConstPtr& message);

/// Creates frames from a camera's images. An instance belongs to one thread at a time.
class FrameMaker {
 public:
  FrameMaker(util::GreyStretch stretch, const CameraView& view) : stretch_(stretch), view_(view) {}

  /// Sets `frame` to the image of the message, without features. Throws RefusedImage if greyImage()
  /// does, if a mask and the image differ in size, or if the roi is outside of the image.
  void make(const sensor_msgs::ImageConstPtr& message, Frame& frame);

 private:
  const cv::Mat& maskOf(const cv::Size& size);
  void setCamera(Frame& frame);

  util::GreyStretch stretch_;
  CameraView view_;
  // Reused memory, so that images need no allocation in steady state.
  util::Pool<PixelMemory> memory_{8, [](PixelMemory& memory) { memory.message.reset(); }};
  std::optional<PixelCamera> camera_;  // camera for images of the size `camera_size_`
  cv::Size camera_size_;
  cv::Mat mask_;  // combination of all masks of view_, for images of the size of this matrix
};

}  // namespace ktgp_orb
