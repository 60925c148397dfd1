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

/// Sets `mask` to 0 wherever the mask `other` is 0. `name`: name of `other` for the error message.
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
  // If someone still uses the matrix of an earlier frame, although that frame was destroyed, leave
  // the matrix to them and allocate a new one.
  if (util::isShared(memory->grey)) memory->grey.release();
  toFrame(message, stretch_, memory, frame);
  frame.mask = maskOf(frame.image.size());
  frame.lens = view_.lens;
  if (frame.lens && frame.lens->calibration().image_size != frame.image.size()) {
    frame.lens = nullptr;  // the lens is for another image size
  }
  setCamera(frame);
}

/// Sets the camera of the frame. The camera is computed again only if the image size changes. If
/// the camera_info is unusable, the frame gets no camera; the node reports why.
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
  // If `frame.lens` already rectifies the keypoints, their distortion must not be removed again.
  frame.camera_lens = frame.lens ? nullptr : camera_->lens;
}

// Combines all masks and the region of interest. The result is computed again only if the image
// size changes.
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
