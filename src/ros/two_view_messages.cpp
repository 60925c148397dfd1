#include <ktgp_orb/MatchStatus.h>
#include <ktgp_orb/TwoViewGeometry.h>
#include <sensor_msgs/PointCloud2.h>
#include <sensor_msgs/point_cloud2_iterator.h>

#include <Eigen/Geometry>
#include <boost/make_shared.hpp>
#include <vector>

#include "ros/answer_message.h"
#include "ros/message_conversion.h"
#include "ros/pose_message.h"
#include "two_view/cameras.h"
#include "two_view/fields.h"

namespace ktgp_orb {
namespace {

static_assert(int(Geometry::none) == TwoViewGeometry::GEOMETRY_NONE, "");
static_assert(int(Geometry::plane) == TwoViewGeometry::GEOMETRY_PLANE, "");
static_assert(int(Geometry::rotation) == TwoViewGeometry::GEOMETRY_ROTATION, "");
static_assert(int(Geometry::epipolar) == TwoViewGeometry::GEOMETRY_EPIPOLAR, "");
static_assert(int(Doubt::two_motions_of_a_plane) == TwoViewGeometry::DOUBT_TWO_MOTIONS_OF_A_PLANE,
              "");
static_assert(int(Doubt::few_points_off_the_plane) ==
                  TwoViewGeometry::DOUBT_FEW_POINTS_OFF_THE_PLANE,
              "");
static_assert(int(Doubt::small_parallax) == TwoViewGeometry::DOUBT_SMALL_PARALLAX, "");
static_assert(int(Doubt::repetitive) == TwoViewGeometry::DOUBT_REPETITIVE, "");
static_assert(int(Doubt::moving_region) == TwoViewGeometry::DOUBT_MOVING_REGION, "");
static_assert(int(Doubt::mirrored) == TwoViewGeometry::DOUBT_MIRRORED, "");
static_assert(int(Doubt::other_motion) == TwoViewGeometry::DOUBT_OTHER_MOTION, "");
static_assert(int(Doubt::undetermined) == TwoViewGeometry::DOUBT_UNDETERMINED, "");

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
  if (!view.other) return;
  message.other_pose.push_back(toMessage(toPose(view.other->pose), view.other->pose_covariance));
  message.other_geometry = static_cast<std::uint8_t>(view.other->geometry);
}

}  // namespace

TwoViewGeometryPtr toTwoView(const MatchedFrame& frame) {
  const SequenceMatch& match = frame.match;
  const MatchResult& result = match.match;
  if (result.stage(StageId::two_view) == nullptr) return nullptr;
  auto message = boost::make_shared<TwoViewGeometry>();
  message->header = frame.header;
  message->pose.pose.orientation.w = 1.0;
  if (match.reference) message->reference_stamp = timeOf(match.reference->stamp);
  message->status = static_cast<std::uint8_t>(result.status);
  message->reason = static_cast<std::uint8_t>(match.no_reference);
  message->geometry = static_cast<std::uint8_t>(result.geometry);
  const TwoView& view = result.two_view.view;
  message->doubt = static_cast<std::uint8_t>(view.doubt);
  if (result.geometry == Geometry::none) return message;
  setPose(view, *message);
  const CopyField copy;
  copy("fundamental", view.fundamental, message->fundamental);
  two_view::visitNumbers(
      [](const two_view::NumberField& /*field*/, double from, double& to) { to = from; }, view,
      *message);
  message->inliers = static_cast<std::uint32_t>(result.inliers);
  message->rmse = result.rmse;
  return message;
}

/// The triangulated points of the scene, in the frame of the target's camera (frame_id of the
/// header). The field `deviation` is the standard deviation of the distance.
sensor_msgs::PointCloud2Ptr toPoints(const MatchedFrame& frame) {
  const SequenceMatch& match = frame.match;
  const MatchResult& result = match.match;
  const bool is_on = result.stage(StageId::two_view) != nullptr;
  if (!is_on || !match.reference || !match.reference->camera || !match.frame->camera)
    return nullptr;
  TwoViewInput input;
  input.reference_camera = match.reference->camera;
  input.target_camera = match.frame->camera;
  const TwoView& view = result.two_view.view;
  std::vector<ScenePoint> points;
  if (view.mask.size() == result.two_view.pairs.size()) {
    triangulate(result.two_view, input, points);
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
    out[3] = static_cast<float>(two_view::distanceDeviation(point));
    ++out;
  }
  return message;
}

}  // namespace ktgp_orb
