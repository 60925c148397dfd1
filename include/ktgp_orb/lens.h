#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <vector>

namespace ktgp_orb {

/// Lens model.
enum class LensModel : std::uint8_t {
  radial_tangential,  ///< 0, 4, 5, 8, 12 or 14 coefficients in OpenCV's order (k1 k2 p1 p2 k3 ...)
  equidistant,        ///< fisheye: 4 coefficients (Kannala & Brandt, PAMI 2006)
};

/// Calibration of a camera. All lengths are in px of images with the size `image_size`.
struct LensCalibration {
  LensModel model = LensModel::radial_tangential;
  cv::Size image_size;
  cv::Matx33d camera = cv::Matx33d::eye();  ///< camera matrix K, px
  std::vector<double> distortion;           ///< coefficients, in the order of LensModel
  /// Rotation from the camera's frame to the frame of the rectified image (R of camera_info).
  cv::Matx33d rotation = cv::Matx33d::eye();
  /// Camera matrix K of the rectified image (without distortion), px.
  cv::Matx33d rectified_camera = cv::Matx33d::eye();

  bool operator==(const LensCalibration& other) const;
};

/// Removes lens distortion, so that straight lines of the scene are straight in the image and a
/// homography maps a plane of the scene to the image.
///
/// Immutable: several threads may use one instance.
class Lens {
 public:
  /// Throws std::invalid_argument for focal lengths that no camera has, a wrong number of
  /// coefficients, numbers that are not finite, and a distortion that cannot be inverted near the
  /// middle of the image.
  explicit Lens(const LensCalibration& calibration);

  const LensCalibration& calibration() const { return calibration_; }

  /// Moves keypoints to their positions in the image without distortion, accurate to 1e-3 px. A
  /// position may be outside the image. It is NaN if the keypoint's ray is more than 60 degrees
  /// from the optical axis, or if the model maps two rays to the keypoint's pixel.
  void rectify(std::vector<cv::KeyPoint>& keypoints) const;
  /// Computes the image without distortion, of the same size as `image`.
  void rectify(const cv::Mat& image, cv::Mat& rectified) const;

 private:
  LensCalibration calibration_;
};

using LensConstPtr = std::shared_ptr<const Lens>;

}  // namespace ktgp_orb
