#include "ros/frame_maker.h"

#include <algorithm>
#include <memory>
#include <opencv2/imgproc.hpp>
#include <sstream>
#include <stdexcept>

#include "util/format.h"
#include "util/shared_matrix.h"

namespace ktgp_orb {
namespace {

using util::text;

/// Sets `mask` to 0 where `other` is 0.
void narrow(const cv::Mat& other, const std::string& name, cv::Mat& mask) {
  if (other.empty()) return;
  if (other.size() != mask.size()) {
    throw RefusedImage(name + " is " + text(other.size()) + "; expected " + text(mask.size()) +
                       " like the image");
  }
  mask.setTo(0, other == 0);
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
  return maskImage(message);
}

void FrameMaker::make(const sensor_msgs::ImageConstPtr& message, Frame& frame) {
  const std::shared_ptr<PixelMemory> memory = memory_.take();
  // Do not overwrite a matrix that a caller still uses although its frame was destroyed.
  if (util::isShared(memory->grey)) memory->grey.release();
  toFrame(message, stretch_, memory, frame);
  frame.mask = maskOf(frame.image.size());
  frame.lens = view_.lens;
  if (frame.lens && frame.lens->calibration().image_size != frame.image.size()) {
    frame.lens = nullptr;  // the lens is for another image size
  }
  setCamera(frame);
}

/// Sets the camera, which is computed once for all images of one size. An unusable camera_info
/// gives no camera; the node reports why.
void FrameMaker::setCamera(Frame& frame) {
  frame.camera.reset();
  frame.camera_lens = nullptr;
  if (!view_.camera) return;
  if (camera_size_ != frame.image.size()) {
    camera_size_ = frame.image.size();
    camera_.reset();
    try {
      camera_ = twoViewCamera(*view_.camera, view_.pixels, camera_size_);
    } catch (const std::invalid_argument&) {
      return;
    }
  }
  if (!camera_) return;
  frame.camera = camera_->camera;
  // If the points are rectified, they need no lens.
  frame.camera_lens = frame.lens ? nullptr : camera_->lens;
}

// The combined mask, computed once for all images of one size.
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
  if (hidesAll(mask)) {
    throw RefusedImage(
        "the masks and the roi together hide the whole image; expected a part that "
        "all of them look at");
  }
  mask_ = mask;
  return mask_;
}

}  // namespace ktgp_orb
