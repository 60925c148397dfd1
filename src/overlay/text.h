#pragma once

#include <opencv2/core.hpp>
#include <string>

namespace ktgp_orb::overlay {

/// Sizes of text and strokes, in px, for an image size.
class Typeface {
 public:
  /// For an image of `size`: legible at 320x240, and in proportion at 1920x1080.
  explicit Typeface(const cv::Size& size);

  int lineHeight() const { return line_height_; }
  int stroke() const { return stroke_; }
  int width(const std::string& text) const;
  /// White text; `corner` is the upper left one of the line.
  void draw(cv::Mat& canvas, const std::string& text, const cv::Point& corner) const;

 private:
  double scale_;
  int line_height_;
  int stroke_;
};

/// Darkens a part of the canvas, so that text on it is legible.
void darken(cv::Mat& canvas, const cv::Rect& area);

}  // namespace ktgp_orb::overlay
