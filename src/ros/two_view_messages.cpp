#include <ktgp_orb/MatchStatus.h>
#include <ktgp_orb/TwoViewGeometry.h>
#include <sensor_msgs/PointCloud2.h>
#include <sensor_msgs/point_cloud2_iterator.h>

#include <Eigen/Geometry>
#include <boost/make_shared.hpp>
#include <cmath>
#include <vector>

#include "ros/message_conversion.h"
#include "ros/pose_message.h"
#include "two_view/cameras.h"

namespace ktgp_orb {
namespace {

static_assert(int(Geometry::none) == TwoViewGeometry::GEOMETRY_NONE, "");
static_assert(int(Geometry::plane) == TwoViewGeometry::GEOMETRY_PLANE, "");
static_assert(int(Geometry::rotation) == TwoViewGeometry::GEOMETRY_ROTATION, "");
static_assert(int(Geometry::epipolar) == TwoViewGeometry::GEOMETRY_EPIPOLAR, "");

Pose3 toPose(const RelativePose& pose) {
  Pose3 out = Pose3::Identity();
  out.linear() = pose.rotation;
  out.translation() = pose.translation;
  return out;
}

void setPose(const TwoView& view, TwoViewGeometry& message) {
  if (!two_view::hasPose(view)) return;
  message.has_pose = true;
  message.pose = toMessage(toPose(view.pose), view.pose_covariance);
  message.parallax = view.parallax;
  if (!view.other) return;
  message.other_pose.push_back(
      toMessage(toPose(view.other->pose), view.other->pose_covariance).pose);
}

}  // namespace

TwoViewGeometryPtr toTwoView(const MatchedFrame& frame) {
  const SequenceMatch& match = frame.match;
  const MatchResult& result = match.match;
  if (result.stage("two_view") == nullptr) return nullptr;
  auto message = boost::make_shared<TwoViewGeometry>();
  message->header = frame.header;
  message->pose.pose.orientation.w = 1.0;
  if (match.reference) message->reference_stamp = timeOf(match.reference->stamp);
  message->status = static_cast<std::uint8_t>(result.found());
  message->reason = static_cast<std::uint8_t>(match.no_reference);
  message->geometry = static_cast<std::uint8_t>(result.geometry);
  if (result.geometry == Geometry::none) return message;
  const TwoView& view = result.two_view.view;
  setPose(view, *message);
  Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(message->fundamental.data()) =
      view.fundamental;
  message->inliers = static_cast<std::uint32_t>(result.inliers);
  message->rmse = result.rmse;
  message->log_false_alarms_homography = view.log_false_alarms_homography;
  message->log_false_alarms_epipolar = view.log_false_alarms_epipolar;
  return message;
}

/// In the frame of the target's camera, as the header says; `deviation` is that of the distance.
sensor_msgs::PointCloud2Ptr toPoints(const MatchedFrame& frame) {
  const SequenceMatch& match = frame.match;
  const MatchResult& result = match.match;
  const bool is_on = result.stage("two_view") != nullptr;
  if (!is_on || !match.reference || !match.reference->camera || !match.frame->camera)
    return nullptr;
  TwoViewInput input;
  input.reference_camera = match.reference->camera;
  input.target_camera = match.frame->camera;
  const TwoView& view = result.two_view.view;
  std::vector<ScenePoint> points;
  if (view.mask.size() == result.two_view.pairs.size()) {
    triangulate(result.two_view.pairs, input, view, points);
  }
  auto message = boost::make_shared<sensor_msgs::PointCloud2>();
  message->header = frame.header;
  sensor_msgs::PointCloud2Modifier modifier(*message);
  using sensor_msgs::PointField;
  modifier.setPointCloud2Fields(4, "x", 1, PointField::FLOAT32, "y", 1, PointField::FLOAT32, "z", 1,
                                PointField::FLOAT32, "deviation", 1, PointField::FLOAT32);
  modifier.resize(points.size());
  message->is_dense = true;
  sensor_msgs::PointCloud2Iterator<float> out(*message, "x");
  for (const ScenePoint& point : points) {
    const Eigen::Vector3d p = view.pose.rotation * point.position + view.pose.translation;
    for (int i = 0; i < 3; ++i) out[i] = static_cast<float>(p[i]);
    const Eigen::Vector3d ray = point.position.normalized();
    out[3] = static_cast<float>(std::sqrt(ray.dot(point.covariance * ray)));
    ++out;
  }
  return message;
}

}  // namespace ktgp_orb
