#pragma once

#include <opencv2/core.hpp>
#include <string>

#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/two_view.h"

/// Helpers for pixels, colours and text, which all drawings use.
namespace ktgp_orb::overlay {

inline const cv::Scalar kWhite(255, 255, 255);
inline const cv::Scalar kBlack(0, 0, 0);

/// Colour (BGR) of the matches that ended at stage `level`, from knn to ktgp. Matches that the
/// ratio filter removed are grey. Final matches of an epipolar geometry are green. The colours are
/// from Okabe & Ito, "Color Universal Design" (2008), and can be distinguished with all kinds of
/// colour vision.
const cv::Scalar& colourOf(Level level, Geometry geometry);

/// Copies the image as 8-bit BGR into `region`, which must have the same size. Throws
/// std::invalid_argument for an image that is neither CV_8UC1 nor CV_8UC3.
void copyAsBgr(const cv::Mat& image, cv::Mat region);

/// Sizes of text and strokes, in px, that suit an image size.
class Typeface {
 public:
  /// Chooses sizes for an image of `size`, so that text is legible at 320x240 and in proportion at
  /// 1920x1080.
  explicit Typeface(const cv::Size& size);

  int lineHeight() const { return line_height_; }
  int stroke() const { return stroke_; }
  int width(const std::string& text) const;
  /// Draws white text; `corner` is the upper left corner of the line.
  void draw(cv::Mat& canvas, const std::string& text, const cv::Point& corner) const;

 private:
  double scale_;
  int line_height_;
  int stroke_;
};

/// Darkens a part of the canvas, so that text on it is legible.
void darken(cv::Mat& canvas, const cv::Rect& area);

}  // namespace ktgp_orb::overlay
