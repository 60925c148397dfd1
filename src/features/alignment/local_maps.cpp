#include "features/alignment/local_maps.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "util/constants.h"

namespace ktgp_orb::alignment {
namespace {

constexpr std::size_t kNeighbours = 12;

}  // namespace

void LocalMaps::load(const std::vector<Eigen::Vector2d>& reference,
                     const std::vector<Eigen::Vector2d>& target, const cv::Size& image) {
  reference_ = &reference;
  target_ = &target;
  const double each = static_cast<double>(image.width) * image.height /
                      static_cast<double>(std::max<std::size_t>(reference.size(), 1));
  spacing_ = std::sqrt(each * kNeighbours / util::kPi);
  const auto point = [&](std::size_t i) {
    return cv::Point2f(static_cast<float>(reference[i].x()), static_cast<float>(reference[i].y()));
  };
  grid_.build(reference.size(), point, image, std::max(0.5 * spacing_, 1.0));
}

void LocalMaps::findNeighbours(std::size_t i) {
  constexpr int kWidenings = 4;
  const Eigen::Vector2d& centre = (*reference_)[i];
  double radius = spacing_;
  for (int k = 0; k < kWidenings; ++k, radius *= 2.0) {
    near_.clear();
    grid_.visitNear(centre.x(), centre.y(), radius, [&](std::int32_t other) {
      if (static_cast<std::size_t>(other) == i) return;
      const double d2 = ((*reference_)[static_cast<std::size_t>(other)] - centre).squaredNorm();
      if (d2 < radius * radius) near_.emplace_back(d2, other);
    });
    if (near_.size() >= kNeighbours) break;
  }
  const std::size_t count = std::min(near_.size(), kNeighbours);
  std::partial_sort(near_.begin(), near_.begin() + static_cast<std::ptrdiff_t>(count), near_.end());
  near_.resize(count);
}

Eigen::Matrix3d LocalMaps::at(std::size_t i) {
  constexpr int kRounds = 3;
  // Weight of the similarity map, relative to the weight of all neighbours together.
  constexpr double kPrior = 0.1;
  // px; a neighbour with this deviation from the map gets half the weight.
  constexpr double kNear = 2.0;
  findNeighbours(i);
  const Eigen::Vector2d from = (*reference_)[i];
  const Eigen::Vector2d to = (*target_)[i];
  Eigen::Matrix2d map = Eigen::Matrix2d::Identity();
  for (int round = 0; round < kRounds; ++round) {
    Eigen::Matrix2d squares = Eigen::Matrix2d::Zero();
    Eigen::Matrix2d products = Eigen::Matrix2d::Zero();
    for (const auto& [d2, other] : near_) {
      const Eigen::Vector2d d = (*reference_)[static_cast<std::size_t>(other)] - from;
      const Eigen::Vector2d e = (*target_)[static_cast<std::size_t>(other)] - to;
      const double off = round == 0 ? 0.0 : (map * d - e).norm() / kNear;
      const double weight = 1.0 / (1.0 + off * off);
      squares += weight * d * d.transpose();
      products += weight * e * d.transpose();
    }
    const double size = squares.trace();
    if (!(size > 0.0)) break;
    Eigen::Matrix2d similarity;
    similarity(0, 0) = similarity(1, 1) = products.trace() / size;
    similarity(1, 0) = (products(1, 0) - products(0, 1)) / size;
    similarity(0, 1) = -similarity(1, 0);
    const double prior = kPrior * 0.5 * size;
    map =
        (products + prior * similarity) * (squares + prior * Eigen::Matrix2d::Identity()).inverse();
  }
  Eigen::Matrix3d homography = Eigen::Matrix3d::Identity();
  homography.topLeftCorner<2, 2>() = map;
  homography.topRightCorner<2, 1>() = to - map * from;
  return homography;
}

}  // namespace ktgp_orb::alignment
