#pragma once

#include <sensor_msgs/CameraInfo.h>

#include <Eigen/Core>
#include <cstdint>
#include <opencv2/core/types.hpp>
#include <string>

#include "ktgp_orb/lens.h"

namespace ktgp_orb {

/// What a camera's images are.
enum class Pixels : std::uint8_t {
  raw,        ///< as the camera sends them: K and the distortion of its camera_info
  rectified,  ///< without distortion, image_proc's image_rect for example: P of its camera_info
};

/// `name`: by_name, raw or rectified. With by_name, images are rectified where the last part of
/// their topic's name begins with image_rect, as image_proc names them. Throws
/// std::invalid_argument.
Pixels pixelsFrom(const std::string& name, const std::string& image_topic);

/// The camera that belongs to the pixels of an image.
struct PixelCamera {
  Eigen::Matrix3d camera = Eigen::Matrix3d::Identity();  ///< K of an image without distortion, px
  LensConstPtr
      lens;  ///< moves points of the image to where `camera` has them; null: they are there
};

/// The camera of images of `image_size`. Binning and a region of interest of the camera are
/// applied. Throws std::invalid_argument, saying what is wrong, for an uncalibrated camera (K is
/// zero), numbers that are not finite, a camera_info of another size, and a distortion model that
/// is not plumb_bob, rational_polynomial or equidistant.
PixelCamera pixelCamera(const sensor_msgs::CameraInfo& info, Pixels pixels,
                        const cv::Size& image_size);

/// The lens of raw images of the camera, of whatever size they are. Throws as pixelCamera.
LensConstPtr lensFrom(const sensor_msgs::CameraInfo& info);

}  // namespace ktgp_orb
