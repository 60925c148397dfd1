#include "evaluation/rendering.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace ktgp_orb::evaluation {
namespace {

/// Number of samples along each side of a pixel of the view. They hit every pixel of the source at
/// the strongest reduction on a grid of points of the view, up to 16 times.
int samplesPerSide(const cv::Size& source, const Eigen::Matrix3d& source_from_view,
                   const cv::Size& view) {
  constexpr int kGrid = 8;
  constexpr double kMost = 16.0;
  double shrink = 1.0;
  for (int i = 0; i <= kGrid; ++i) {
    for (int j = 0; j <= kGrid; ++j) {
      const Eigen::Vector2d u(view.width * i / double{kGrid}, view.height * j / double{kGrid});
      const Eigen::Vector3d p = source_from_view * u.homogeneous();
      const Eigen::Vector2d x = p.hnormalized();
      if (!(p.z() > 0.0) || !isInside(source, x.x(), x.y())) continue;
      for (const Eigen::Vector2d& step : {Eigen::Vector2d(1.0, 0.0), Eigen::Vector2d(0.0, 1.0)}) {
        const Eigen::Vector3d q = source_from_view * (u + step).homogeneous();
        shrink = std::max(shrink, (q.hnormalized() - x).norm());
      }
    }
  }
  return static_cast<int>(std::ceil(std::min(shrink, kMost))) + 1;
}

}  // namespace

bool isInside(const cv::Size& size, double x, double y) {
  return x >= 0.0 && y >= 0.0 && x <= size.width - 1.0 && y <= size.height - 1.0;
}

float sampleBilinear(const cv::Mat& image, double x, double y) {
  const int left = std::min(static_cast<int>(x), std::max(0, image.cols - 2));
  const int top = std::min(static_cast<int>(y), std::max(0, image.rows - 2));
  const int right = std::min(left + 1, image.cols - 1);
  const int bottom = std::min(top + 1, image.rows - 1);
  const auto a = static_cast<float>(x - left);
  const auto b = static_cast<float>(y - top);
  const auto* upper = image.ptr<float>(top);
  const auto* lower = image.ptr<float>(bottom);
  const float above = upper[left] + a * (upper[right] - upper[left]);
  const float below = lower[left] + a * (lower[right] - lower[left]);
  return above + b * (below - above);
}

cv::Mat renderView(const cv::Mat& source, const Eigen::Matrix3d& source_from_view,
                   const cv::Size& size) {
  const int n = samplesPerSide(source.size(), source_from_view, size);
  const Eigen::Vector3d step = source_from_view.col(0) / n;  // from sample to sample of a row
  cv::Mat view(size, CV_32F, cv::Scalar(0.0));
  for (int row = 0; row < n * size.height; ++row) {
    auto* out = view.ptr<float>(row / n);
    const double y = (row + 0.5) / n - 0.5;
    const Eigen::Vector3d start = source_from_view * Eigen::Vector3d(0.5 / n - 0.5, y, 1.0);
    for (int column = 0; column < n * size.width; ++column) {
      const Eigen::Vector3d p = start + column * step;
      const double px = p.x() / p.z();
      const double py = p.y() / p.z();
      if (p.z() > 0.0 && isInside(source.size(), px, py)) {
        out[column / n] += sampleBilinear(source, px, py);
      }
    }
  }
  view /= n * n;
  return view;
}

}  // namespace ktgp_orb::evaluation
