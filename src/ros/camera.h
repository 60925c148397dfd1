#pragma once

#include <sensor_msgs/CameraInfo.h>

#include <Eigen/Core>
#include <cstdint>
#include <opencv2/core/types.hpp>
#include <optional>
#include <string>

#include "ktgp_orb/lens.h"

namespace ktgp_orb {

/// How the images of a camera were processed before we receive them.
enum class Pixels : std::uint8_t {
  raw,        ///< as the camera sends them: K and D of the camera_info apply
  rectified,  ///< distortion removed, such as image_proc's image_rect: P of camera_info applies
};

/// The topic of the images without the suffix of a transport: "/camera/image_raw" for
/// "/camera/image_raw/compressed".
std::string rawTopic(const std::string& topic);

/// Guesses from the name of an image topic whether its images are raw or rectified; empty if the
/// name does not tell. Uses the last part of the name that begins with "image" and contains the
/// word rect, rectified or raw: image_rect_color, image_mono_rect, image_raw. If there is no such
/// part, but another part is "rectified", the images are rectified: rectified/image. All other
/// parts are ignored, because a transport or a relay may have appended them.
std::optional<Pixels> pixelsOf(const std::string& image_topic);

/// Converts `name`, the value of a parameter (by_name, raw or rectified), to Pixels. For by_name,
/// uses pixelsOf(image_topic), or raw if the topic does not tell. Throws std::invalid_argument for
/// any other value.
Pixels pixelsFrom(const std::string& name, const std::string& image_topic);

struct PixelCamera {
  Eigen::Matrix3d camera = Eigen::Matrix3d::Identity();  ///< K of the image without distortion, px
  /// Maps points of the raw image to pixels of an image with the matrix `camera`; null: there is no
  /// distortion.
  LensConstPtr lens;
};

/// Computes the camera for images of `image_size`, with binning and region of interest applied.
/// Throws std::invalid_argument, with the reason, for an uncalibrated camera (K is zero), numbers
/// that are not finite, a camera_info for another image size, and a distortion model other than
/// plumb_bob, rational_polynomial or equidistant.
PixelCamera pixelCamera(const sensor_msgs::CameraInfo& info, Pixels pixels,
                        const cv::Size& image_size);

/// Like pixelCamera(), for the two-view geometry. Also throws for a K that the two-view geometry
/// refuses, for example with a principal point outside of the image.
PixelCamera twoViewCamera(const sensor_msgs::CameraInfo& info, Pixels pixels,
                          const cv::Size& image_size);

/// The matrix K that pixelCamera() computes; empty if pixelCamera() refuses the camera_info.
std::optional<Eigen::Matrix3d> cameraIfUsable(const sensor_msgs::CameraInfo& info, Pixels pixels,
                                              const cv::Size& image_size);

/// The size of the images that a camera_info describes, px.
cv::Size imageSize(const sensor_msgs::CameraInfo& info);

/// The lens for raw images of the size that the camera_info gives. Throws like pixelCamera(), but
/// does not compare the size with an image.
LensConstPtr lensFrom(const sensor_msgs::CameraInfo& info);

}  // namespace ktgp_orb
