#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "core/homography/transform.h"
#include "core/two_view/cameras.h"

namespace ktgp_orb {

void triangulate(const PointPairs& pairs, const TwoViewInput& input, const TwoView& geometry,
                 std::vector<ScenePoint>& points) {
  constexpr double kClear = 2.0;        // scales of the errors
  constexpr double kLeastScale = 0.05;  // px
  points.clear();
  const std::optional<two_view::Cameras> cameras = two_view::camerasOf(input);
  if (!cameras || geometry.status != Status::ok || geometry.pose.translation.isZero(0.0)) return;
  if (geometry.mask.size() != pairs.size()) {
    throw std::invalid_argument("the geometry is of " + std::to_string(geometry.mask.size()) +
                                " pairs, and there are " + std::to_string(pairs.size()));
  }
  const Eigen::Matrix3d turn = geometry.pose.rotation;
  const Eigen::Vector3d t = geometry.pose.translation;
  const Eigen::Matrix3d far = cameras->homographyOf(turn);
  const double scale = std::max(geometry.scale > 0.0 ? geometry.scale : geometry.rmse, kLeastScale);
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (geometry.mask[i] == 0) continue;
    if (homography::errorOf(far, pairs.reference[i], pairs.target[i]) < kClear * scale) continue;
    // The inverse depth z: the target point is K' (R q + z t), linear in z after multiplication.
    const Eigen::Vector3d q = cameras->referenceRay(pairs.reference[i]);
    const Eigen::Vector3d a = cameras->target * turn * q;
    const Eigen::Vector3d b = cameras->target * t;
    const Eigen::Vector2d u = pairs.target[i];
    const Eigen::Vector2d slope = b.head<2>() - u * b.z();
    const Eigen::Vector2d value = u * a.z() - a.head<2>();
    const double inverse_depth = slope.dot(value) / slope.squaredNorm();
    const double depth = 1.0 / inverse_depth;
    if (!(inverse_depth > 1e-9) || !((a + inverse_depth * b).z() > 0.0)) continue;
    ScenePoint point;
    point.pair = i;
    point.position = depth * q;
    // px of the target by depth, then the two directions across the ray.
    const Eigen::Vector3d seen = a + inverse_depth * b;
    const double by_inverse = slope.norm() / seen.z();
    const double depth_deviation = std::sqrt(2.0) * scale / by_inverse * depth * depth;
    const double across = scale * depth / cameras->reference(0, 0);
    point.covariance = depth_deviation * depth_deviation * q * q.transpose();
    point.covariance(0, 0) += across * across;
    point.covariance(1, 1) += across * across;
    points.push_back(point);
  }
}

}  // namespace ktgp_orb
