#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace ktgp_orb::demo {

/// Convex polygon in map pixels, corners in order (either way round).
using Polygon = std::vector<cv::Point2f>;

double area(const Polygon& polygon);
cv::Point2f centre(const Polygon& polygon);

/// The part of a convex polygon on the side of `point` that `normal` points to.
Polygon cut(const Polygon& polygon, cv::Point2f point, cv::Point2f normal);

/// Intersection of two convex polygons; may be empty.
Polygon intersect(const Polygon& a, const Polygon& b);

/// The convex polygon with every side moved inwards by `margin` px; may be empty.
Polygon shrink(const Polygon& polygon, float margin);

/// Rectangle of `size` px around `middle` whose first side runs along the unit vector `along`.
Polygon rectangle(cv::Point2f middle, cv::Size2f size, cv::Point2f along);

Polygon shifted(const Polygon& polygon, cv::Point2f by);

/// A filled disc (one corner and a radius) or a filled convex polygon (radius zero).
struct Shape {
  Polygon corners;
  float radius = 0.F;  ///< px
  cv::Scalar colour;   ///< blue, green, red; 0..255
};

/// Paints the shapes in order, anti-aliased, on an 8-bit image of one or three channels. Uses bands
/// of fixed height on all threads, so the result does not depend on the number of threads.
void paint(const std::vector<Shape>& shapes, cv::Mat& image);

}  // namespace ktgp_orb::demo
