#include "overlay/canvas.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <stdexcept>

namespace ktgp_orb::overlay {

const cv::Scalar& colourOf(Level level, Geometry geometry) {
  static const cv::Scalar epipolar(115, 158, 0);
  static const std::array<cv::Scalar, 4> colours{{
      {150, 150, 150},
      {233, 180, 86},
      {167, 121, 204},
      {66, 228, 240},
  }};
  if (level >= Level::ktgp && geometry == Geometry::epipolar) return epipolar;
  return colours[std::min<std::size_t>(static_cast<std::size_t>(level), colours.size() - 1)];
}

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

// At scale 1, capital letters of OpenCV's plain typeface are 21 px high. Below scale 0.38 they are
// illegible, even in a window that is only 400 px wide.
Typeface::Typeface(const cv::Size& size)
    : scale_(std::clamp(std::min(size.width / 1100.0, size.height / 800.0), 0.38, 3.0)),
      line_height_(static_cast<int>(std::lround(38.0 * scale_))),
      stroke_(std::max(1, static_cast<int>(std::lround(1.6 * scale_)))) {}

int Typeface::width(const std::string& text) const {
  return cv::getTextSize(text, cv::FONT_HERSHEY_SIMPLEX, scale_, stroke_, nullptr).width;
}

void Typeface::draw(cv::Mat& canvas, const std::string& text, const cv::Point& corner) const {
  const cv::Point baseline(corner.x, corner.y + static_cast<int>(std::lround(0.75 * line_height_)));
  cv::putText(canvas, text, baseline, cv::FONT_HERSHEY_SIMPLEX, scale_, kWhite, stroke_,
              cv::LINE_AA);
}

void darken(cv::Mat& canvas, const cv::Rect& area) {
  const cv::Rect visible = area & cv::Rect({0, 0}, canvas.size());
  if (visible.empty()) return;
  cv::Mat region = canvas(visible);
  region.convertTo(region, -1, 0.3);
}

}  // namespace ktgp_orb::overlay
