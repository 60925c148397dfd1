#include "ros/camera.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/core/eigen.hpp>
#include <set>
#include <sstream>
#include <stdexcept>
#include <string>

#include "ktgp_orb/two_view.h"
#include "util/camera_check.h"
#include "util/format.h"

namespace ktgp_orb {
namespace {

LensModel modelFrom(const std::string& name) {
  if (name == "plumb_bob" || name == "rational_polynomial") return LensModel::radial_tangential;
  if (name == "equidistant") return LensModel::equidistant;
  throw std::invalid_argument("distortion_model is '" + name.substr(0, 64) +
                              "'; expected plumb_bob, rational_polynomial or equidistant");
}

template <typename Numbers>
void requireFinite(const Numbers& numbers, const std::string& name) {
  if (std::all_of(numbers.begin(), numbers.end(), [](double x) { return std::isfinite(x); })) {
    return;
  }
  throw std::invalid_argument(name + " of the camera_info has a number that is not finite");
}

void requireCalibrated(const sensor_msgs::CameraInfo& info) {
  requireFinite(info.K, "K");
  requireFinite(info.D, "D");
  requireFinite(info.R, "R");
  requireFinite(info.P, "P");
  if (info.K[0] == 0.0) {
    throw std::invalid_argument("the camera is not calibrated: K of its camera_info is zero");
  }
}

/// Adapts the camera matrix, which was calibrated for the whole sensor, to the region of interest
/// and the binning of `info`.
void shrink(const sensor_msgs::CameraInfo& info, cv::Matx33d& camera) {
  camera(0, 2) -= info.roi.x_offset;
  camera(1, 2) -= info.roi.y_offset;
  for (int column = 0; column < 3; ++column) {
    camera(0, column) /= std::max(1U, info.binning_x);
    camera(1, column) /= std::max(1U, info.binning_y);
  }
}

/// Returns true if the lens leaves every point in place, because it has neither distortion nor a
/// rectifying rotation.
bool isStraight(const LensCalibration& lens) {
  const bool distorts = std::any_of(lens.distortion.begin(), lens.distortion.end(),
                                    [](double coefficient) { return coefficient != 0.0; });
  return !distorts && lens.model == LensModel::radial_tangential &&
         lens.rotation == cv::Matx33d::eye();
}

}  // namespace

cv::Size imageSize(const sensor_msgs::CameraInfo& info) {
  const std::uint32_t width = info.roi.width > 0 ? info.roi.width : info.width;
  const std::uint32_t height = info.roi.height > 0 ? info.roi.height : info.height;
  return {static_cast<int>(width / std::max(1U, info.binning_x)),
          static_cast<int>(height / std::max(1U, info.binning_y))};
}

std::string rawTopic(const std::string& topic) {
  for (const std::string transport : {"/compressed", "/compressedDepth", "/theora"}) {
    const std::size_t end = topic.size() - std::min(topic.size(), transport.size());
    if (topic.compare(end, std::string::npos, transport) == 0) return topic.substr(0, end);
  }
  return topic;
}

std::optional<Pixels> pixelsOf(const std::string& image_topic) {
  const auto kind_of = [](const std::string& part) -> std::optional<Pixels> {
    std::optional<Pixels> kind;
    std::istringstream words(part);
    for (std::string word; std::getline(words, word, '_');) {
      if (word == "rect" || word == "rectified") return Pixels::rectified;
      if (word == "raw") kind = Pixels::raw;
    }
    return kind;
  };
  std::istringstream parts(image_topic);
  std::optional<Pixels> of_folders;
  std::optional<Pixels> of_image;
  for (std::string part; std::getline(parts, part, '/');) {
    const std::optional<Pixels> kind = kind_of(part);
    const bool is_image = part.compare(0, 5, "image") == 0;
    if (is_image && kind) of_image = kind;
    if (!is_image && part == "rectified") of_folders = kind;
  }
  return of_image ? of_image : of_folders;
}

Pixels pixelsFrom(const std::string& name, const std::string& image_topic) {
  if (name == "raw") return Pixels::raw;
  if (name == "rectified") return Pixels::rectified;
  if (name == "by_name") return pixelsOf(image_topic).value_or(Pixels::raw);
  throw std::invalid_argument("calibration is '" + name + "'; expected by_name, raw or rectified");
}

LensConstPtr lensFrom(const sensor_msgs::CameraInfo& info) {
  requireCalibrated(info);
  LensCalibration calibration;
  calibration.model = modelFrom(info.distortion_model);
  calibration.image_size = imageSize(info);
  if (calibration.image_size.empty()) {
    throw std::invalid_argument("the camera_info has no image size (width and height)");
  }
  calibration.distortion = info.D;
  std::copy(info.K.begin(), info.K.end(), calibration.camera.val);
  std::copy(info.R.begin(), info.R.end(), calibration.rotation.val);
  const bool has_rotation = cv::norm(calibration.rotation) > 0.0;
  if (!has_rotation) calibration.rotation = cv::Matx33d::eye();
  const cv::Matx34d projection(info.P.data());
  calibration.rectified_camera = projection.get_minor<3, 3>(0, 0);
  if (info.P[0] == 0.0) calibration.rectified_camera = calibration.camera;
  // Check this before shrink(): the principal point must be in the whole image, but it may be
  // outside of the region of interest.
  const cv::Size whole(static_cast<int>(info.width), static_cast<int>(info.height));
  util::requirePrincipalPoint("K of the camera_info", calibration.camera, whole);
  shrink(info, calibration.camera);
  shrink(info, calibration.rectified_camera);
  return std::make_shared<const Lens>(calibration);
}

PixelCamera pixelCamera(const sensor_msgs::CameraInfo& info, Pixels pixels,
                        const cv::Size& image_size) {
  requireCalibrated(info);
  sensor_msgs::CameraInfo known = info;
  // Without distortion, drivers often leave the name of the model empty. Models with other names
  // may be of fisheye lenses, which distort even if all coefficients are zero.
  std::string model = info.distortion_model;
  for (char& c : model) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  const std::set<std::string> pinholes = {"",
                                          "none",
                                          "pinhole",
                                          "perspective",
                                          "plumb_bob",
                                          "rational_polynomial",
                                          "radtan",
                                          "thin_prism",
                                          "brown_conrady",
                                          "brown-conrady",
                                          "inverse_brown_conrady"};
  const bool distorts =
      pinholes.count(model) == 0 ||
      std::any_of(info.D.begin(), info.D.end(), [](double x) { return x != 0.0; });
  if (pixels == Pixels::rectified || !distorts) {
    known.distortion_model = "plumb_bob";
    known.D.clear();
  }
  const LensConstPtr lens = lensFrom(known);
  const LensCalibration& calibration = lens->calibration();
  if (calibration.image_size != image_size) {
    throw std::invalid_argument("the camera_info is of " + util::text(calibration.image_size) +
                                " images (width and height, roi and binning applied); expected " +
                                util::text(image_size) + " like the image");
  }
  PixelCamera found;
  if (pixels == Pixels::raw && isStraight(calibration)) {
    cv::cv2eigen(calibration.camera, found.camera);
    return found;
  }
  cv::cv2eigen(calibration.rectified_camera, found.camera);
  if (pixels == Pixels::raw) found.lens = lens;
  return found;
}

PixelCamera twoViewCamera(const sensor_msgs::CameraInfo& info, Pixels pixels,
                          const cv::Size& image_size) {
  PixelCamera camera = pixelCamera(info, pixels, image_size);
  TwoViewInput input;
  input.reference_camera = camera.camera;
  input.reference_size = input.target_size = image_size;
  estimateTwoView({}, {}, input);  // throws for a bad K now, before the first frame
  return camera;
}

std::optional<Eigen::Matrix3d> cameraIfUsable(const sensor_msgs::CameraInfo& info, Pixels pixels,
                                              const cv::Size& image_size) {
  try {
    return pixelCamera(info, pixels, image_size).camera;
  } catch (const std::invalid_argument&) {
    return std::nullopt;
  }
}

}  // namespace ktgp_orb
