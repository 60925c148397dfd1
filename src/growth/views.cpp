// Simulated views of a reference, with the tilts of ASIFT.
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "homography/transform.h"
#include "ktgp_orb/growth.h"
#include "util/constants.h"
#include "util/options_check.h"

namespace ktgp_orb {
namespace {

/// The simulated tilts. For each tilt: the factor by which it compresses the image, and the number
/// of directions, within 180 degrees, in which it is simulated.
constexpr std::pair<double, int> kTilts[] = {{2.0, 4}, {4.0, 8}};

/// The image mapped by `linear`, placed in its bounding box. `map`: applies `linear` and moves the
/// centre of the image to the centre of the box. `size`: size of the box, px.
struct Placed {
  Placed(const Eigen::Matrix2d& linear, const cv::Size& image) {
    const Eigen::Vector2d sides = linear.cwiseAbs() * Eigen::Vector2d(image.width, image.height);
    size = cv::Size(static_cast<int>(std::ceil(sides.x())), static_cast<int>(std::ceil(sides.y())));
    const Eigen::Vector2d middle(0.5 * (image.width - 1), 0.5 * (image.height - 1));
    map.leftCols<2>() = linear;
    map.col(2) = Eigen::Vector2d(0.5 * (size.width - 1), 0.5 * (size.height - 1)) - linear * middle;
  }

  Eigen::Matrix<double, 2, 3> map;
  cv::Size size;
};

/// The part of `image` that is needed to draw these columns of the view, with a rim for the
/// interpolation.
cv::Rect partFor(const cv::Range& columns, const Placed& placed, const cv::Size& image) {
  constexpr double kRim = 2.0;  // px
  const Eigen::Matrix2d back = placed.map.leftCols<2>().inverse();
  Eigen::AlignedBox2d box;
  for (const int x : {columns.start, columns.end}) {
    for (const int y : {0, placed.size.height}) {
      box.extend(Eigen::Vector2d(back * (Eigen::Vector2d(x, y) - placed.map.col(2))));
    }
  }
  const Eigen::Vector2i first = (box.min().array() - kRim).floor().cast<int>();
  const Eigen::Vector2i last = (box.max().array() + kRim).ceil().cast<int>();
  return cv::Rect({first.x(), first.y()}, cv::Point(last.x(), last.y())) & cv::Rect({0, 0}, image);
}

/// Warps the image into its bounding box, part by part, since OpenCV warps at most 32766 rows or
/// columns.
cv::Mat drawn(const cv::Mat& image, const Placed& placed) {
  constexpr int kColumns = 4096;
  cv::Mat result(placed.size, image.type(), cv::Scalar(0));
  for (int left = 0; left < placed.size.width; left += kColumns) {
    const cv::Range columns(left, std::min(left + kColumns, placed.size.width));
    const cv::Rect part = partFor(columns, placed, image.size());
    if (part.empty()) continue;
    Eigen::Matrix<double, 2, 3> map = placed.map;
    map.col(2) += map.leftCols<2>() * Eigen::Vector2d(part.x, part.y) - Eigen::Vector2d(left, 0.0);
    const cv::Matx23d m(map(0, 0), map(0, 1), map(0, 2), map(1, 0), map(1, 1), map(1, 2));
    cv::warpAffine(image(part), result.colRange(columns), m, {columns.size(), placed.size.height},
                   cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  }
  return result;
}

// Standard deviation of the blur before the compression, px of the rotated image (Morel & Yu).
double blurFor(double tilt) {
  constexpr double kBlur = 0.8;  // blur per unit of sqrt(tilt² - 1)
  return kBlur * std::sqrt(tilt * tilt - 1.0);
}

/// Blurs `image` along `direction` with a Gaussian whose standard deviation is `sigma` px.
cv::Mat blurredAlong(const Eigen::Vector2d& direction, double sigma, const cv::Mat& image) {
  const int reach = static_cast<int>(std::ceil(3.0 * sigma));
  cv::Mat kernel(2 * reach + 1, 2 * reach + 1, CV_32F);
  for (int y = -reach; y <= reach; ++y) {
    for (int x = -reach; x <= reach; ++x) {
      const double along = (direction.x() * x + direction.y() * y) / sigma;
      // The kernel is a line one pixel wide.
      const double across = std::abs(direction.x() * y - direction.y() * x);
      kernel.at<float>(y + reach, x + reach) =
          static_cast<float>(std::exp(-0.5 * along * along) * std::max(0.0, 1.0 - across));
    }
  }
  kernel /= cv::sum(kernel)[0];
  cv::Mat blurred;
  cv::filter2D(image, blurred, -1, kernel, {-1, -1}, 0.0, cv::BORDER_REPLICATE);
  return blurred;
}

/// Rotates the image by `turn`, blurs it along its rows and compresses the rows by the factor
/// `tilt`.
cv::Mat compressed(const cv::Mat& image, const Eigen::Matrix2d& turn, double tilt,
                   const Placed& view) {
  const Placed turned_place(turn, image.size());
  cv::Mat blurred;
  cv::GaussianBlur(turn.isIdentity(0.0) ? image : drawn(image, turned_place), blurred,
                   cv::Size(0, 1), blurFor(tilt), 1e-6, cv::BORDER_REPLICATE);
  // The middle of the image becomes the middle of the view.
  const cv::Size& turned = turned_place.size;
  const cv::Matx23d squeeze(1.0 / tilt, 0.0,
                            0.5 * (view.size.width - 1) - 0.5 * (turned.width - 1) / tilt,  //
                            0.0, 1.0, 0.5 * (view.size.height - 1) - 0.5 * (turned.height - 1));
  cv::Mat squeezed;
  cv::warpAffine(blurred, squeezed, squeeze, view.size, cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  return squeezed;
}

/// Returns true if an image is long, such as a tape or a panorama. A view of a long image is
/// rotated until the long side of the image lies along the rows, because a long image at 45 degrees
/// would fill only a strip of a large square. Views may be rotated, since descriptors do not depend
/// on the rotation.
bool isLong(const cv::Size& size) {
  // If the ratio of the sides is larger, this square has more than three times as many pixels as
  // the image.
  constexpr int kRatio = 4;
  return std::max(size.width, size.height) > kRatio * std::min(size.width, size.height);
}

Eigen::Matrix2d rotation(double angle) {
  return Eigen::Rotation2Dd(angle).toRotationMatrix();
}

/// Mask of the view: 255 at pixels that show a part of the image at least `border` px away from the
/// image's edges, else 0.
cv::Mat insideOf(const cv::Size& image, double border, const Eigen::Matrix<double, 2, 3>& to_view,
                 const cv::Size& view) {
  cv::Mat mask = cv::Mat::zeros(view, CV_8U);
  std::vector<cv::Point> outline;
  const double far_x = image.width - 1.0 - border;
  const double far_y = image.height - 1.0 - border;
  for (const auto& [x, y] : {std::pair(border, border), std::pair(far_x, border),
                             std::pair(far_x, far_y), std::pair(border, far_y)}) {
    const Eigen::Vector2d p = to_view * Eigen::Vector3d(x, y, 1.0);
    outline.emplace_back(cvRound(p.x()), cvRound(p.y()));
  }
  cv::fillConvexPoly(mask, outline, 255);
  return mask;
}

ReferenceView simulate(const cv::Mat& image, const OrbOptions& options, double angle, double tilt) {
  // Side of a descriptor's patch on the finest pyramid level, px of the image.
  const double margin = 31.0 / std::pow(options.scale_factor, options.first_level);
  const Eigen::Matrix2d turn = rotation(angle);
  Eigen::Matrix2d linear = Eigen::Vector2d(1.0 / tilt, 1.0).asDiagonal() * turn;
  const bool is_long = isLong(image.size());
  if (is_long) {
    const Eigen::Vector2d side = linear.col(image.cols > image.rows ? 0 : 1);
    linear = rotation(-std::atan2(side.y(), side.x())) * linear;
  }
  const Placed placed(linear, image.size());
  const cv::Size size = placed.size;
  const cv::Mat squeezed = is_long ? drawn(blurredAlong(turn.row(0), blurFor(tilt), image), placed)
                                   : compressed(image, turn, tilt, placed);
  ReferenceView view;
  view.to_view = placed.map;

  const cv::Mat mask = insideOf(image.size(), 0.5 * margin, view.to_view, size);
  OrbOptions fewer = options;
  fewer.max_features = std::max(1, cvRound(options.max_features / tilt));
  fewer.images = ImageKeeping::none;
  OrbExtractor(fewer).extract(squeezed, mask, view.features);
  return view;
}

/// Shrinks an image that has more pixels than a square of 2500 px; no frame in which targets are
/// searched for has a longer side than this. A rotated image takes less than four times as many
/// pixels as the image, so memory and time for a view are bounded for any image.
cv::Mat withoutExcess(const cv::Mat& image) {
  constexpr double kMostPixels = 2500.0 * 2500.0;
  const double scale = std::sqrt(kMostPixels / static_cast<double>(image.total()));
  if (scale >= 1.0) return image;
  const cv::Size size(std::max(1, static_cast<int>(scale * image.cols)),
                      std::max(1, static_cast<int>(scale * image.rows)));
  cv::Mat small;
  cv::resize(image, small, size, 0.0, 0.0, cv::INTER_AREA);
  return small;
}

}  // namespace

ReferenceViews simulateViews(const cv::Mat& image, const OrbOptions& options, int views) {
  util::requireInRange("views", views, 0, 13);
  ReferenceViews made;
  if (image.empty()) return made;
  const cv::Mat small = withoutExcess(image);
  for (const auto& [tilt, directions] : kTilts) {
    if (1 + static_cast<int>(made.size()) + directions > views) break;
    for (int d = 0; d < directions; ++d) {
      made.push_back(simulate(small, options, util::kPi * d / directions, tilt));
      ReferenceView& view = made.back();
      view.to_view = view.to_view * homography::resizing(image.size(), small.size());
    }
  }
  return made;
}

}  // namespace ktgp_orb
