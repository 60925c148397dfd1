#include "overlay/canvas.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

namespace ktgp_orb::overlay {

void copyAsBgr(const cv::Mat& image, cv::Mat region) {
  if (image.type() == CV_8UC3) {
    image.copyTo(region);
  } else if (image.type() == CV_8UC1) {
    cv::cvtColor(image, region, cv::COLOR_GRAY2BGR);
  } else {
    throw std::invalid_argument("overlay image is " + cv::typeToString(image.type()) +
                                "; expected CV_8UC1 or CV_8UC3");
  }
}

void drawSideBySide(const cv::Mat& reference, const cv::Mat& target, cv::Mat& canvas) {
  canvas.create(std::max(reference.rows, target.rows), reference.cols + target.cols, CV_8UC3);
  canvas.setTo(cv::Scalar::all(0));
  if (!reference.empty()) copyAsBgr(reference, canvas(cv::Rect({0, 0}, reference.size())));
  if (!target.empty()) copyAsBgr(target, canvas(cv::Rect({reference.cols, 0}, target.size())));
}

}  // namespace ktgp_orb::overlay
