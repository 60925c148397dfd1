#pragma once

#include <sensor_msgs/CameraInfo.h>

#include <Eigen/Core>
#include <cstdint>
#include <opencv2/core/types.hpp>
#include <optional>
#include <string>

#include "ktgp_orb/lens.h"

namespace ktgp_orb {

/// Kind of the images of a camera.
enum class Pixels : std::uint8_t {
  raw,        ///< as sent by the camera: K and the distortion of its camera_info apply
  rectified,  ///< without distortion, such as image_proc's image_rect: P of its camera_info applies
};

/// The topic of the images without the suffix of a transport: "/camera/image_raw" for
/// "/camera/image_raw/compressed".
std::string rawTopic(const std::string& topic);

/// Guesses from the name of a topic whether its images are raw or rectified; empty if the name does
/// not tell. Uses the last part of the name that begins with "image" and contains the word rect,
/// rectified or raw: image_rect_color, image_mono_rect, image_raw. Without such a part, a part
/// "rectified" means rectified images: rectified/image. Ignores other parts, which a transport or a
/// relay may append.
std::optional<Pixels> pixelsOf(const std::string& image_topic);

/// The kind of the images for the value `name` of a parameter: by_name, raw or rectified. For
/// by_name, the kind is pixelsOf(), or raw if the topic does not tell. Throws std::invalid_argument
/// for another name.
Pixels pixelsFrom(const std::string& name, const std::string& image_topic);

struct PixelCamera {
  Eigen::Matrix3d camera = Eigen::Matrix3d::Identity();  ///< K of an image without distortion, px
  /// Maps points of the raw image to pixels of `camera`; null: there is no distortion.
  LensConstPtr lens;
};

/// The camera for images of `image_size`, with binning and region of interest applied. Throws
/// std::invalid_argument, with the reason, for an uncalibrated camera (K is zero), numbers that are
/// not finite, a camera_info of another size, and a distortion model other than plumb_bob,
/// rational_polynomial or equidistant.
PixelCamera pixelCamera(const sensor_msgs::CameraInfo& info, Pixels pixels,
                        const cv::Size& image_size);

/// Like pixelCamera(), for the two-view geometry. Also throws for a K that the two-view geometry
/// refuses, for example with a principal point outside of the image.
PixelCamera twoViewCamera(const sensor_msgs::CameraInfo& info, Pixels pixels,
                          const cv::Size& image_size);

/// K of pixelCamera(); empty if pixelCamera() refuses the camera_info.
std::optional<Eigen::Matrix3d> cameraIfUsable(const sensor_msgs::CameraInfo& info, Pixels pixels,
                                              const cv::Size& image_size);

/// The size of the images that a camera_info describes, px.
cv::Size imageSize(const sensor_msgs::CameraInfo& info);

/// Throws std::invalid_argument unless `seconds` is a readout time of a shutter: -1 (not known), or
/// from -0.2 to 0.2, negative if the last row is exposed first.
void requireReadoutTime(double seconds);

/// The lens for raw images of the camera, whatever their size. Throws like pixelCamera().
LensConstPtr lensFrom(const sensor_msgs::CameraInfo& info);

}  // namespace ktgp_orb
