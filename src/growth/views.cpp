// Simulated views of a reference: ASIFT's tilts.
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "ktgp_orb/growth.h"
#include "util/constants.h"
#include "util/options_check.h"

namespace ktgp_orb {
namespace {

/// Ratios by which the image is compressed, in so many directions within half a turn.
constexpr std::pair<double, int> kTilts[] = {{2.0, 4}, {4.0, 8}};

/// The image rotated by `angle` and compressed in one direction, large enough to contain all of it.
Eigen::Matrix<double, 2, 3> toView(const cv::Size& size, double angle, double tilt,
                                   cv::Size& view) {
  const double c = std::cos(angle);
  const double s = std::sin(angle);
  const double width = std::abs(c) * size.width + std::abs(s) * size.height;
  const double height = std::abs(s) * size.width + std::abs(c) * size.height;
  view = cv::Size(static_cast<int>(std::ceil(width / tilt)), static_cast<int>(std::ceil(height)));
  Eigen::Matrix<double, 2, 3> to_view;
  to_view << c / tilt, -s / tilt, 0.0, s, c, 0.0;
  const Eigen::Vector2d middle(0.5 * (size.width - 1), 0.5 * (size.height - 1));
  to_view.col(2) = Eigen::Vector2d(0.5 * (view.width - 1), 0.5 * (view.height - 1)) -
                   to_view.leftCols<2>() * middle;
  return to_view;
}

cv::Matx23d matrixOf(const Eigen::Matrix<double, 2, 3>& m) {
  return {m(0, 0), m(0, 1), m(0, 2), m(1, 0), m(1, 1), m(1, 2)};
}

ReferenceView simulate(const cv::Mat& image, const OrbOptions& options, double angle, double tilt) {
  constexpr double kBlur = 0.8;  // px of the rotated image per unit of tilt: Morel & Yu
  // Width of a patch, px.
  const double margin = 31.0 / std::pow(options.scale_factor, options.first_level);
  cv::Size size, turned_size;
  ReferenceView view;
  view.to_view = toView(image.size(), angle, tilt, size);
  const Eigen::Matrix<double, 2, 3> turn = toView(image.size(), angle, 1.0, turned_size);
  cv::Mat turned, squeezed;
  if (angle == 0.0) {
    turned = image;
  } else {
    cv::warpAffine(image, turned, matrixOf(turn), turned_size, cv::INTER_LINEAR,
                   cv::BORDER_REPLICATE);
  }
  cv::Mat blurred;
  cv::GaussianBlur(turned, blurred, cv::Size(0, 1), kBlur * std::sqrt(tilt * tilt - 1.0), 1e-6,
                   cv::BORDER_REPLICATE);
  // Map from the rotated image to the view, which is compressed about the middle.
  Eigen::Matrix<double, 2, 3> squeeze;
  squeeze << 1.0 / tilt, 0.0, 0.5 * (size.width - 1) - 0.5 * (turned_size.width - 1) / tilt,  //
      0.0, 1.0, 0.5 * (size.height - 1) - 0.5 * (turned_size.height - 1);
  cv::warpAffine(blurred, squeezed, matrixOf(squeeze), size, cv::INTER_LINEAR,
                 cv::BORDER_REPLICATE);

  // Keypoints only inside the image, not in its extended border.
  cv::Mat mask = cv::Mat::zeros(size, CV_8U);
  std::vector<cv::Point> outline;
  const double far_x = image.cols - 1.0 - 0.5 * margin;
  const double far_y = image.rows - 1.0 - 0.5 * margin;
  for (const auto& [x, y] : {std::pair(0.5 * margin, 0.5 * margin), std::pair(far_x, 0.5 * margin),
                             std::pair(far_x, far_y), std::pair(0.5 * margin, far_y)}) {
    const Eigen::Vector2d p = view.to_view * Eigen::Vector3d(x, y, 1.0);
    outline.emplace_back(cvRound(p.x()), cvRound(p.y()));
  }
  cv::fillConvexPoly(mask, outline, 255);

  OrbOptions fewer = options;
  fewer.max_features = std::max(1, cvRound(options.max_features / tilt));
  fewer.images = ImageKeeping::none;
  OrbExtractor(fewer).extract(squeezed, mask, view.features);
  return view;
}

}  // namespace

ReferenceViews simulateViews(const cv::Mat& image, const OrbOptions& options, int views) {
  util::requireInRange("views", views, 0, 13);
  ReferenceViews made;
  if (image.empty()) return made;
  for (const auto& [tilt, directions] : kTilts) {
    if (1 + static_cast<int>(made.size()) + directions > views) break;
    for (int d = 0; d < directions; ++d) {
      made.push_back(simulate(image, options, util::kPi * d / directions, tilt));
    }
  }
  return made;
}

}  // namespace ktgp_orb
