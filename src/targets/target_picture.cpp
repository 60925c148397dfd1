#include "targets/target_picture.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <stdexcept>
#include <utility>

#include "homography/transform.h"
#include "ktgp_orb/growth.h"

namespace ktgp_orb::targets {
namespace {

// A keypoint must be at least this many diameters of its patch away from the target's border,
// because beyond the border the frame shows something else.
constexpr double kInside = 0.35;
// The image and its views get a pyramid with this many levels at each of kSizes. All pyramids
// together reach down to about an eighth of the image's size (with a scale factor of 1.2), and each
// level has enough keypoints.
constexpr int kLevels = 5;
// Sizes at which the image and its tilted views are stored: the scale, and the number of keypoints
// as a share of the wanted number.
constexpr std::pair<double, double> kSizes[] = {{1.0, 1.0}, {0.5, 2.0 / 3.0}, {0.25, 1.0 / 3.0}};
constexpr double kLeastSize = 40.0;  // minimum longer side of a shrunk image, px
// Minimum shorter side of the image. In a narrower image, no keypoint is far enough from both long
// borders.
constexpr int kLeastRoom = 24;  // px

cv::Mat limited(const cv::Mat& image, int largest_side, double& scale) {
  scale = std::min(1.0, largest_side / static_cast<double>(std::max(image.cols, image.rows)));
  if (scale == 1.0) return image.clone();
  const cv::Size size(std::max(1, cvRound(image.cols * scale)),
                      std::max(1, cvRound(image.rows * scale)));
  cv::Mat small;
  cv::resize(image, small, size, 0, 0, cv::INTER_AREA);
  return small;
}

/// Stores copies of the image at a half, a quarter and so on of its size, to speed up shrink().
void addHalves(TargetPicture& picture) {
  constexpr int kLeastSide = 64;  // px
  cv::Mat last = picture.image;
  while (std::min(last.cols, last.rows) >= kLeastSide) {
    cv::Mat half;
    cv::resize(last, half, last.size() / 2, 0, 0, cv::INTER_AREA);
    picture.halves.push_back(half);
    last = half;
  }
}

/// Removes the keypoints of `view` that are too near the border of the target.
void keepInside(const cv::Size& target, ReferenceView& view) {
  const Eigen::Matrix2d from_view = view.to_view.leftCols<2>().inverse();
  const double scale = std::sqrt(std::abs(from_view.determinant()));
  Features& features = view.features;
  if (features.empty()) return;  // a narrow picture may have no keypoints
  std::size_t kept = 0;
  for (std::size_t i = 0; i < features.size(); ++i) {
    const cv::KeyPoint& keypoint = features.keypoints[i];
    const Eigen::Vector2d p =
        from_view * (Eigen::Vector2d(keypoint.pt.x, keypoint.pt.y) - view.to_view.col(2));
    const double margin = kInside * scale * keypoint.size;
    if (p.x() < margin || p.y() < margin || p.x() > target.width - 1 - margin ||
        p.y() > target.height - 1 - margin) {
      continue;
    }
    features.keypoints[kept] = keypoint;
    features.descriptors.row(static_cast<int>(i))
        .copyTo(features.descriptors.row(static_cast<int>(kept)));
    ++kept;
  }
  features.keypoints.resize(kept);
  features.descriptors = features.descriptors.rowRange(0, static_cast<int>(kept));
}

/// Adds the image at `scale` and its tilted views. Their `to_view` maps px of the target's image to
/// px of the view.
void addViews(const cv::Mat& image, double scale, const OrbOptions& orb, int views,
              ReferenceViews& made) {
  cv::Mat small, padded;
  cv::resize(image, small, cv::Size(), scale, scale, cv::INTER_AREA);
  cv::copyMakeBorder(small, padded, kPictureBorder, kPictureBorder, kPictureBorder, kPictureBorder,
                     cv::BORDER_REPLICATE);
  Eigen::Matrix3d to_padded = homography::resizing(image.size(), small.size());
  to_padded.col(2) += Eigen::Vector3d(kPictureBorder, kPictureBorder, 0.0);

  ReferenceViews all = simulateViews(padded, orb, views);
  ReferenceView whole;
  OrbExtractor(orb).extract(padded, whole.features);
  whole.to_view = Eigen::Matrix<double, 2, 3>::Identity();
  all.insert(all.begin(), std::move(whole));
  for (ReferenceView& view : all) {
    view.to_view = view.to_view * to_padded;
    keepInside(image.size(), view);
    made.push_back(std::move(view));
  }
}

}  // namespace

TargetPicture makePicture(const cv::Mat& image, const OrbOptions& orb, int features,
                          int largest_side, int views) {
  if (image.empty()) throw std::invalid_argument("the image is empty");
  if (image.type() != CV_8UC1) throw std::invalid_argument("the image is not 8-bit grey");
  TargetPicture picture;
  picture.full_size = image.size();
  picture.image = limited(image, largest_side, picture.scale);
  if (std::min(picture.image.cols, picture.image.rows) < kLeastRoom) return picture;
  addHalves(picture);
  OrbOptions options = orb;
  options.images = ImageKeeping::none;
  options.distribution = KeypointDistribution::ranked;
  options.levels = std::min(orb.levels, kLevels);
  ReferenceViews made;
  for (const auto& [scale, share] : kSizes) {
    const int longer = std::max(picture.image.cols, picture.image.rows);
    if (scale < 1.0 && scale * longer < kLeastSize) break;
    options.max_features = static_cast<int>(share * features);
    addViews(picture.image, scale, options, views, made);
  }

  // The first entry is the image itself, whose keypoints become the keypoints of the reference.
  Features own = std::move(made.front().features);
  for (cv::KeyPoint& keypoint : own.keypoints)
    keypoint.pt -= cv::Point2f(kPictureBorder, kPictureBorder);
  own.image_size = picture.image.size();
  made.erase(made.begin());
  picture.own = own.size();
  picture.frames.set(own, &made);
  return picture;
}

void shrink(const TargetPicture& picture, const cv::Size& size, cv::InterpolationFlags method,
            cv::Mat& small) {
  const cv::Mat* from = &picture.image;
  for (const cv::Mat& half : picture.halves) {
    if (half.cols >= size.width && half.rows >= size.height) from = &half;
  }
  cv::resize(*from, small, size, 0, 0, method);
}

Eigen::Vector2d middleOf(const cv::Size& image) {
  return {0.5 * (image.width - 1), 0.5 * (image.height - 1)};
}

cv::Size2d sizeIn(const Eigen::Matrix3d& homography, const cv::Size& image) {
  const Eigen::Matrix2d jacobian = homography::jacobianByPoint(homography, middleOf(image));
  return {jacobian.col(0).norm() * image.width, jacobian.col(1).norm() * image.height};
}

Eigen::Matrix3d toStored(const TargetPicture& picture) {
  return homography::resizing(picture.full_size, picture.image.size());
}

}  // namespace ktgp_orb::targets
