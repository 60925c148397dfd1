#include "overlay/text.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "overlay/palette.h"

namespace ktgp_orb::overlay {

// Capitals of OpenCV's plain typeface are 21 px high at scale 1; below 0.38 they are illegible,
// also in a window 400 px wide.
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
