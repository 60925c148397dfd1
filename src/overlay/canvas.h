#pragma once

#include <opencv2/core.hpp>
#include <string>

#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/two_view.h"

/// Helper functions for pixels, colours and text; all drawings use them.
namespace ktgp_orb::overlay {

inline const cv::Scalar kWhite(255, 255, 255);
inline const cv::Scalar kBlack(0, 0, 0);

/// Colour (BGR) of the matches whose last passed stage is `level`: knn, kt, ktg or ktgp. Matches
/// that the ratio filter removed (level knn) are grey. Final matches of an epipolar geometry are
/// green. The colours are from Okabe & Ito, "Color Universal Design" (2008), and can be
/// distinguished with all kinds of colour vision.
const cv::Scalar& colourOf(Level level, Geometry geometry);

/// Copies the image as 8-bit BGR into `region`, a part of a canvas with the same size as the image.
/// Throws std::invalid_argument for an image that is neither CV_8UC1 nor CV_8UC3.
void copyAsBgr(const cv::Mat& image, cv::Mat region);

/// Sizes of text and strokes that suit the size of an image, px.
class Typeface {
 public:
  /// Chooses sizes for an image of `size`: text is still legible at 320x240, and in proportion to
  /// the image at 1920x1080.
  explicit Typeface(const cv::Size& size);

  int lineHeight() const { return line_height_; }
  int stroke() const { return stroke_; }
  int width(const std::string& text) const;
  /// Draws white text. `corner`: upper left corner of the line of text.
  void draw(cv::Mat& canvas, const std::string& text, const cv::Point& corner) const;

 private:
  double scale_;
  int line_height_;
  int stroke_;
};

/// Darkens `area` of the canvas, so that white text on it is legible.
void darken(cv::Mat& canvas, const cv::Rect& area);

}  // namespace ktgp_orb::overlay
