#include "demo/canvas.h"

#include <algorithm>
#include <cmath>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include "util/divide.h"

namespace ktgp_orb::demo {
namespace {

constexpr int kBandHeight = 256;  // px
constexpr int kFractionBits = 4;  // fraction bits of the coordinates that OpenCV gets
constexpr float kFractionScale = 1 << kFractionBits;

/// Unit normal of a side, pointing to `inside`.
cv::Point2f inwardNormal(cv::Point2f from, cv::Point2f to, cv::Point2f inside) {
  const cv::Point2f side = to - from;
  const auto length = static_cast<float>(std::max(cv::norm(side), 1e-6));
  const cv::Point2f normal(-side.y / length, side.x / length);
  return normal.dot(inside - from) < 0.F ? -normal : normal;
}

cv::Point toFixed(cv::Point2f point) {
  return {cvRound(point.x * kFractionScale), cvRound(point.y * kFractionScale)};
}

void paintOne(const Shape& shape, float top, cv::Mat& band, std::vector<cv::Point>& corners) {
  const cv::Point2f offset(0.F, top);
  if (shape.radius > 0.F) {
    cv::circle(band, toFixed(shape.corners[0] - offset), cvRound(shape.radius * kFractionScale),
               shape.colour, cv::FILLED, cv::LINE_AA, kFractionBits);
    return;
  }
  corners.clear();
  for (const cv::Point2f& corner : shape.corners) corners.push_back(toFixed(corner - offset));
  cv::fillConvexPoly(band, corners, shape.colour, cv::LINE_AA, kFractionBits);
}

}  // namespace

double area(const Polygon& polygon) {
  return polygon.empty() ? 0.0 : cv::contourArea(polygon);
}

cv::Point2f centre(const Polygon& polygon) {
  cv::Point2f sum(0.F, 0.F);
  for (const cv::Point2f& corner : polygon) sum += corner;
  return polygon.empty() ? sum : sum / static_cast<float>(polygon.size());
}

Polygon cut(const Polygon& polygon, cv::Point2f point, cv::Point2f normal) {
  Polygon kept;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const cv::Point2f a = polygon[i];
    const cv::Point2f b = polygon[(i + 1) % polygon.size()];
    const float side_a = normal.dot(a - point);
    const float side_b = normal.dot(b - point);
    if (side_a >= 0.F) kept.push_back(a);
    if ((side_a < 0.F) != (side_b < 0.F))
      kept.push_back(a + (b - a) * (side_a / (side_a - side_b)));
  }
  return kept;
}

Polygon intersect(const Polygon& a, const Polygon& b) {
  const cv::Point2f inside = centre(b);
  Polygon kept = a;
  for (std::size_t i = 0; i < b.size() && !kept.empty(); ++i) {
    kept = cut(kept, b[i], inwardNormal(b[i], b[(i + 1) % b.size()], inside));
  }
  return kept;
}

Polygon shrink(const Polygon& polygon, float margin) {
  const cv::Point2f inside = centre(polygon);
  Polygon kept = polygon;
  for (std::size_t i = 0; i < polygon.size() && !kept.empty(); ++i) {
    const cv::Point2f next = polygon[(i + 1) % polygon.size()];
    const cv::Point2f normal = inwardNormal(polygon[i], next, inside);
    kept = cut(kept, polygon[i] + normal * margin, normal);
  }
  return kept;
}

Polygon rectangle(cv::Point2f middle, cv::Size2f size, cv::Point2f along) {
  const cv::Point2f half_width = along * (size.width / 2.F);
  const cv::Point2f half_height = cv::Point2f(-along.y, along.x) * (size.height / 2.F);
  return {middle - half_width - half_height, middle + half_width - half_height,
          middle + half_width + half_height, middle - half_width + half_height};
}

Polygon shifted(const Polygon& polygon, cv::Point2f by) {
  Polygon moved = polygon;
  for (cv::Point2f& corner : moved) corner += by;
  return moved;
}

void paint(const std::vector<Shape>& shapes, cv::Mat& image) {
  const int bands = util::ceilDivide(image.rows, kBandHeight);
  std::vector<std::vector<const Shape*>> shapes_of(static_cast<std::size_t>(bands));
  for (const Shape& shape : shapes) {
    if (shape.corners.empty()) continue;
    const auto [top, bottom] =
        std::minmax_element(shape.corners.begin(), shape.corners.end(),
                            [](const auto& a, const auto& b) { return a.y < b.y; });
    const float margin = shape.radius + 2.F;
    const auto band_at = [](float y) { return static_cast<int>(std::floor(y / kBandHeight)); };
    const int first = std::max(0, band_at(top->y - margin));
    const int last = std::min(bands - 1, band_at(bottom->y + margin));
    for (int i = first; i <= last; ++i) shapes_of[static_cast<std::size_t>(i)].push_back(&shape);
  }
  cv::parallel_for_(cv::Range(0, bands), [&](const cv::Range& range) {
    std::vector<cv::Point> corners;
    for (int i = range.start; i < range.end; ++i) {
      const int top = i * kBandHeight;
      cv::Mat band = image.rowRange(top, std::min(top + kBandHeight, image.rows));
      for (const Shape* shape : shapes_of[static_cast<std::size_t>(i)]) {
        paintOne(*shape, static_cast<float>(top), band, corners);
      }
    }
  });
}

}  // namespace ktgp_orb::demo
