#include "targets/ambiguity.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "core/homography/transform.h"
#include "metrics/repetition.h"
#include "targets/appearance.h"
#include "targets/picture_aligner.h"

namespace ktgp_orb::targets {
namespace {

constexpr double kCopySide = 96.0;       // px of the copy that is moved over itself
constexpr double kLeastMove = 0.08;      // of the side; less is the same place
constexpr double kLeastAlike = 0.5;      // correlation; afterwards the blocks are compared
constexpr double kLeastAgreement = 0.6;  // of the blocks
constexpr double kLeastOverlap = 0.5;
constexpr std::size_t kMostPlaces = 4;  // for each turn

/// px of the copy -> px of the copy turned clockwise by so many quarters.
Eigen::Matrix3d turning(int quarters, const cv::Size& size) {
  Eigen::Matrix3d map = Eigen::Matrix3d::Identity();
  cv::Size now = size;
  for (int i = 0; i < quarters; ++i) {
    Eigen::Matrix3d quarter;
    quarter << 0, -1, now.height - 1, 1, 0, 0, 0, 0, 1;
    map = (quarter * map).eval();
    std::swap(now.width, now.height);
  }
  return map;
}

/// Whether the picture looks like itself under the map, about.
bool looksTheSame(const TargetPicture& picture, const Eigen::Matrix3d& map) {
  const std::vector<cv::Mat> image{picture.image};
  UncertainHomography exact;
  exact.homography = map;
  PointPairs pairs;
  PictureAligner().align(picture, image, exact, pairs);
  if (homography::overlap(exact.homography, picture.image.size()) < kLeastOverlap) return false;
  return Appearance().compare(picture, exact.homography, {image}, 1.0).agreement >= kLeastAgreement;
}

std::string nameOf(int quarters, const Eigen::Vector2d& moved) {
  std::string name;
  if (quarters != 0) name = "turned by " + std::to_string(90 * quarters) + " degrees";
  for (const int axis : {0, 1}) {
    if (std::abs(moved(axis)) < kLeastMove) continue;
    name += (name.empty() ? "moved by " : ", moved by ") +
            std::to_string(std::abs(cvRound(100.0 * moved(axis)))) + " % of its " +
            (axis == 0 ? "width" : "height");
  }
  return name;
}

}  // namespace

std::string ambiguityOf(const TargetPicture& picture) {
  const cv::Size whole = picture.image.size();
  const double scale = std::min(1.0, kCopySide / std::max(whole.width, whole.height));
  const cv::Size size(std::max(8, cvRound(scale * whole.width)),
                      std::max(8, cvRound(scale * whole.height)));
  cv::Mat copy, turned;
  shrink(picture, size, cv::INTER_AREA, copy);
  const Eigen::Matrix3d to_copy = homography::resizing(whole, size);
  for (int quarters = 0; quarters < 4; ++quarters) {
    if (quarters == 0) {
      turned = copy;
    } else {
      cv::rotate(copy, turned, quarters - 1);
    }
    std::vector<cv::Point> shifts = metrics::alikeShifts(turned, copy, kLeastAlike);
    if (shifts.size() > kMostPlaces) shifts.resize(kMostPlaces);
    for (const cv::Point& shift : shifts) {
      Eigen::Matrix3d moving = Eigen::Matrix3d::Identity();
      moving.topRightCorner<2, 1>() << shift.x, shift.y;
      const Eigen::Matrix3d map = to_copy.inverse() * moving * turning(quarters, size) * to_copy;
      const Eigen::Vector2d middle = middleOf(whole);
      const Eigen::Vector2d moved = (homography::project(map, middle) - middle)
                                        .cwiseQuotient(Eigen::Vector2d(whole.width, whole.height));
      if (quarters == 0 && moved.lpNorm<Eigen::Infinity>() < kLeastMove) continue;
      if (looksTheSame(picture, map)) return nameOf(quarters, moved);
    }
  }
  return "";
}

}  // namespace ktgp_orb::targets
