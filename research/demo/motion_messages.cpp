#include "demo/motion_messages.h"

#include <nav_msgs/Odometry.h>
#include <sensor_msgs/Imu.h>
#include <sensor_msgs/Range.h>

#include <Eigen/Geometry>
#include <opencv2/core.hpp>

#include "demo/effects.h"
#include "motion/camera_pose.h"
#include "util/constants.h"

namespace ktgp_orb::demo {
namespace {

constexpr double kRangeNoise = 0.01;                    // share of the range
constexpr double kTiltNoise = 0.5 * util::kPi / 180.0;  // rad
constexpr double kRateNoise = 0.2 * util::kPi / 180.0;  // rad/s

Eigen::Vector3d noise(double deviation, cv::RNG& random) {
  const double x = random.gaussian(deviation);
  const double y = random.gaussian(deviation);
  return {x, y, random.gaussian(deviation)};
}

geometry_msgs::Quaternion quaternionOf(const Eigen::Matrix3d& axes) {
  const Eigen::Quaterniond turn(axes);
  geometry_msgs::Quaternion message;
  message.x = turn.x();
  message.y = turn.y();
  message.z = turn.z();
  message.w = turn.w();
  return message;
}

geometry_msgs::Vector3 vectorOf(const Eigen::Vector3d& v) {
  geometry_msgs::Vector3 message;
  message.x = v.x();
  message.y = v.y();
  message.z = v.z();
  return message;
}

nav_msgs::Odometry truth(const std_msgs::Header& image, double seconds, const Manner& manner) {
  const Eigen::Matrix3d base_from_camera = Eigen::Vector3d(1.0, -1.0, -1.0).asDiagonal();
  motion::CameraPose now = poseAt(seconds, manner);
  motion::CameraPose before = poseAt(seconds - 1.0 / kFrameRate, manner);
  now.axes *= base_from_camera.transpose();
  before.axes *= base_from_camera.transpose();
  const motion::Vector6 twist = kFrameRate * motion::constantTwist(before, now);
  nav_msgs::Odometry message;
  message.header = image;
  message.header.frame_id = "ground";
  message.child_frame_id = image.frame_id + "_level";
  message.pose.pose.position.x = now.position.x();
  message.pose.pose.position.y = now.position.y();
  message.pose.pose.position.z = now.position.z();
  message.pose.pose.orientation = quaternionOf(now.axes);
  message.twist.twist.linear = vectorOf(twist.head<3>());
  message.twist.twist.angular = vectorOf(twist.tail<3>());
  return message;
}

}  // namespace

void writeMotion(const std_msgs::Header& image, double seconds, std::uint64_t seed,
                 const Manner& manner, rosbag::Bag& bag) {
  cv::RNG random(seed + 1000003ULL * (image.seq + 1));
  const motion::CameraPose pose = poseAt(seconds, manner);
  bag.write("/camera/ground_truth/odometry", image.stamp, truth(image, seconds, manner));

  sensor_msgs::Range range;
  range.header = image;
  range.radiation_type = sensor_msgs::Range::INFRARED;
  range.field_of_view = 0.01F;
  range.min_range = 1.0F;
  range.max_range = 500.0F;
  const double distance = -pose.position.z() / pose.axes(2, 2);  // along the optical axis
  range.range = static_cast<float>(distance * (1.0 + random.gaussian(kRangeNoise)));
  bag.write("/camera/range", image.stamp, range);

  sensor_msgs::Imu imu;  // its axes are the axes of the camera
  imu.header = image;
  imu.orientation = quaternionOf(pose.axes * motion::rotationAbout(noise(kTiltNoise, random)));
  const double half = 0.5 / kFrameRate;
  const Eigen::Vector3d turn = motion::turnOf(poseAt(seconds - half, manner).axes.transpose() *
                                              poseAt(seconds + half, manner).axes);
  imu.angular_velocity = vectorOf(kFrameRate * turn + noise(kRateNoise, random));
  for (std::size_t i = 0; i < 9; i += 4) {
    imu.orientation_covariance[i] = kTiltNoise * kTiltNoise;
    imu.angular_velocity_covariance[i] = kRateNoise * kRateNoise;
  }
  imu.linear_acceleration_covariance[0] = -1.0;  // not measured
  bag.write("/camera/imu", image.stamp, imu);
}

}  // namespace ktgp_orb::demo
