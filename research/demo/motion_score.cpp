#include "demo/motion_score.h"

#include <Eigen/Geometry>
#include <cmath>

#include "util/format.h"

namespace ktgp_orb::demo {
namespace {

Eigen::Vector3d positionOf(const nav_msgs::Odometry& odometry) {
  const auto& p = odometry.pose.pose.position;
  return {p.x, p.y, p.z};
}

Eigen::Vector3d velocityOf(const nav_msgs::Odometry& odometry) {
  const auto& v = odometry.twist.twist.linear;
  return {v.x, v.y, v.z};
}

double yawOf(const nav_msgs::Odometry& odometry) {
  const auto& q = odometry.pose.pose.orientation;
  const Eigen::Matrix3d axes = Eigen::Quaterniond(q.w, q.x, q.y, q.z).toRotationMatrix();
  return std::atan2(axes(1, 0), axes(0, 0));
}

}  // namespace

std::string motionScore(const Odometries& truth, const Odometries& found) {
  constexpr double kUnknown = 1e5;  // variance of a velocity that is not known
  if (found.empty() || truth.empty()) return "no odometry to compare";
  const auto first = truth.find(found.begin()->first);
  const auto last = truth.find(found.rbegin()->first);
  if (first == truth.end() || last == truth.end()) return "no odometry to compare";
  double way = 0.0;
  for (auto each = std::next(first); each != truth.end() && each->first <= last->first; ++each) {
    way += (positionOf(each->second) - positionOf(std::prev(each)->second)).norm();
  }
  // The odometry begins above its own origin, so the true motion is turned to its first yaw.
  const double turn = yawOf(found.begin()->second) - yawOf(first->second);
  const Eigen::Matrix3d to_odometry =
      Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  const Eigen::Vector3d moved =
      to_odometry * (positionOf(last->second) - positionOf(first->second));
  const Eigen::Vector3d error =
      positionOf(found.rbegin()->second) - positionOf(found.begin()->second) - moved;
  double squares = 0.0;
  double speeds = 0.0;
  double count = 0.0;
  for (const auto& [stamp, odometry] : found) {
    const auto true_one = truth.find(stamp);
    if (true_one == truth.end() || odometry.twist.covariance[0] > kUnknown) continue;
    squares += (velocityOf(odometry) - velocityOf(true_one->second)).squaredNorm();
    speeds += velocityOf(true_one->second).squaredNorm();
    ++count;
  }
  return util::format("drift %.2f %% of %.0f m, velocity error %.3f m/s (RMS) at %.1f m/s",
                      100.0 * error.norm() / way, way, std::sqrt(squares / std::max(count, 1.0)),
                      std::sqrt(speeds / std::max(count, 1.0)));
}

}  // namespace ktgp_orb::demo
