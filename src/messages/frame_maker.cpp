#include "messages/frame_maker.h"

#include <algorithm>
#include <memory>
#include <opencv2/imgproc.hpp>
#include <sstream>
#include <stdexcept>

#include "messages/image_conversion.h"

namespace ktgp_orb {
namespace {

std::string text(const cv::Size& size) {
  return std::to_string(size.width) + "x" + std::to_string(size.height);
}

/// Leaves of `mask` what `other` has, too.
void narrow(const cv::Mat& other, const std::string& name, cv::Mat& mask) {
  if (other.empty()) return;
  if (other.size() != mask.size()) {
    throw RefusedImage(name + " is " + text(other.size()) + "; expected " + text(mask.size()) +
                       " like the image");
  }
  mask.setTo(0, other == 0);
}

LensModel modelFrom(const std::string& name) {
  if (name == "plumb_bob" || name == "rational_polynomial") return LensModel::radial_tangential;
  if (name == "equidistant") return LensModel::equidistant;
  throw std::invalid_argument("distortion_model is '" + name +
                              "'; expected plumb_bob, rational_polynomial or equidistant");
}

/// `camera`, which is of the whole sensor, for an image that is a part of it, made smaller.
void shrink(const sensor_msgs::CameraInfo& info, cv::Matx33d& camera) {
  camera(0, 2) -= info.roi.x_offset;
  camera(1, 2) -= info.roi.y_offset;
  for (int column = 0; column < 3; ++column) {
    camera(0, column) /= std::max(1U, info.binning_x);
    camera(1, column) /= std::max(1U, info.binning_y);
  }
}

cv::Size imageSize(const sensor_msgs::CameraInfo& info) {
  const std::uint32_t width = info.roi.width > 0 ? info.roi.width : info.width;
  const std::uint32_t height = info.roi.height > 0 ? info.roi.height : info.height;
  return {static_cast<int>(width / std::max(1U, info.binning_x)),
          static_cast<int>(height / std::max(1U, info.binning_y))};
}

}  // namespace

cv::Rect roiFrom(const std::string& text) {
  std::string numbers = text;
  std::replace(numbers.begin(), numbers.end(), ',', ' ');
  std::istringstream in(numbers);
  if ((in >> std::ws).eof()) return {};
  cv::Rect roi;
  in >> roi.x >> roi.y >> roi.width >> roi.height;
  if (!in || !(in >> std::ws).eof() || roi.x < 0 || roi.y < 0 || roi.width < 1 || roi.height < 1) {
    throw std::invalid_argument("roi is '" + text +
                                "'; expected x y width height in whole px, with x and y not below "
                                "0 and a width and height above 0");
  }
  return roi;
}

cv::Mat maskFrom(const sensor_msgs::ImageConstPtr& message) {
  if (message->width == 0 || message->height == 0) return {};
  return greyImage(message).clone();  // the message may go
}

cv::Mat readMaskFile(const std::string& path) {
  const sensor_msgs::ImageConstPtr image = readImageFile("mask_image", path);
  return image ? maskFrom(image) : cv::Mat();
}

LensConstPtr lensFrom(const sensor_msgs::CameraInfo& info) {
  LensCalibration calibration;
  if (info.K[0] == 0.0) {
    throw std::invalid_argument("the camera is not calibrated: K of its camera_info is zero");
  }
  calibration.model = modelFrom(info.distortion_model);
  calibration.image_size = imageSize(info);
  calibration.distortion = info.D;
  std::copy(info.K.begin(), info.K.end(), calibration.camera.val);
  std::copy(info.R.begin(), info.R.end(), calibration.rotation.val);
  const bool has_rotation = cv::norm(calibration.rotation) > 0.0;
  if (!has_rotation) calibration.rotation = cv::Matx33d::eye();
  const cv::Matx34d projection(info.P.data());
  calibration.rectified_camera = projection.get_minor<3, 3>(0, 0);
  if (info.P[0] == 0.0) calibration.rectified_camera = calibration.camera;
  shrink(info, calibration.camera);
  shrink(info, calibration.rectified_camera);
  return std::make_shared<const Lens>(calibration);
}

void FrameMaker::make(const sensor_msgs::ImageConstPtr& message, Frame& frame) {
  toFrame(message, stretch_, memory_.take(), frame);
  frame.mask = maskOf(frame.image.size());
  frame.lens = view_.lens;
  if (frame.lens && frame.lens->calibration().image_size != frame.image.size()) {
    frame.lens = nullptr;  // not of this image
  }
}

// Made once for all images of one size.
const cv::Mat& FrameMaker::maskOf(const cv::Size& size) {
  const bool masked = !view_.file_mask.empty() || !view_.sent_mask.empty();
  if ((!masked && view_.roi.empty()) || mask_.size() == size) return mask_;
  cv::Rect roi = view_.roi.empty() ? cv::Rect({}, size) : view_.roi;
  roi &= cv::Rect({}, size);
  if (roi.empty()) throw RefusedImage("roi is outside of the image of " + text(size));
  cv::Mat mask = cv::Mat::zeros(size, CV_8UC1);
  mask(roi).setTo(255);
  narrow(view_.file_mask, "mask_image", mask);
  narrow(view_.sent_mask, "the image on ~mask", mask);
  mask_ = mask;
  return mask_;
}

}  // namespace ktgp_orb
