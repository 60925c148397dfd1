#include "ros/ground_readings.h"

#include <dynamic_reconfigure/Config.h>
#include <gtest/gtest.h>
#include <ktgp_orb/MatchStatus.h>
#include <tf2/buffer_core.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "refusal.h"
#include "ros/pose_message.h"

namespace ktgp_orb {
namespace {

/// All values with their names.
std::string textOf(const GroundMotionConfig& config) {
  dynamic_reconfigure::Config message;
  config.__toMessage__(message);
  std::ostringstream text;
  text << message;
  return text.str();
}

TEST(GroundReadings, DefaultsEqualTheNodes) {
  const std::string expected = textOf(GroundMotionConfig::__getDefault__());
  test::expectSays(expected, "height_deviation");
  EXPECT_EQ(textOf(groundMotionDefaults()), expected);
}

TEST(GroundReadings, TheHeightsSliderIsOneToDrag) {
  EXPECT_LE(GroundMotionConfig::__getMax__().height, 200.0);
}

/// Why no frame of the camera `cam` can be used; empty: it can.
std::string refusalOf(const std::function<void(GroundMotionConfig&)>& change) {
  GroundMotionConfig config = groundMotionDefaults();
  config.base_frame.clear();
  change(config);
  std_msgs::Header image;
  image.frame_id = "/cam";
  const tf2::BufferCore tf;
  GroundReadings readings(tf);
  return test::refusalOf([&] {
    readings.configure(usable(config), "/range", "/imu");
    readings.optionsFor(image);
  });
}

TEST(GroundReadings, FramesThatTfCannotPlaceAreRefused) {
  using Config = GroundMotionConfig;
  EXPECT_EQ(refusalOf([](Config&) {}), "");
  EXPECT_EQ(refusalOf([](Config& c) { c.odom_frame.clear(); }),
            "odom_frame is empty; expected a frame other than base_frame");
  EXPECT_EQ(refusalOf([](Config& c) { c.odom_frame = c.base_frame = "base"; }),
            "odom_frame is base; expected a frame other than base_frame");
  EXPECT_EQ(refusalOf([](Config& c) {
              c.odom_frame = "base";
              c.base_frame = "/base";
            }),
            "odom_frame is base; expected a frame other than base_frame");
  for (const char* frame : {"cam", "/cam", "cam_level"}) {
    test::expectSays(refusalOf([&](Config& c) { c.odom_frame = frame; }),
                     "the frame of the camera");
  }
  Config config = groundMotionDefaults();
  config.base_frame = "/base_link";
  EXPECT_EQ(usable(config).base_frame, "base_link");
}

TEST(GroundReadings, MeaninglessReadoutTimeIsRefused) {
  for (const double time : {-0.5, 0.201, -0.999}) {
    test::expectSays(refusalOf([time](GroundMotionConfig& c) { c.readout_time = time; }),
                     "expected -1, not known, 0, a global shutter, or up to 0.2 s");
  }
  for (const double time : {-1.0, 0.0, 0.02, -0.02}) {
    EXPECT_EQ(refusalOf([time](GroundMotionConfig& c) { c.readout_time = time; }), "");
  }
}

TEST(GroundReadings, PicturesThatContradictTheReadoutTimeAreSaid) {
  GroundEstimate seen;
  seen.readout_time = -0.0145;
  seen.readout_deviation = 0.0003;
  test::expectSays(shutterTrouble(seen, 0.02),
                   "readout_time is 20.0 ms, but the pictures show -14.5");
  test::expectSays(shutterTrouble(seen, 0.02), "below 0 where the driver turns the images");
  for (const double time : {-1.0, -0.015, -0.016})
    EXPECT_EQ(shutterTrouble(seen, time), "") << time;
  seen.readout_deviation = 0.01;
  EXPECT_EQ(shutterTrouble(seen, 0.02), "") << "they show too little";
}

/// Readings of a range and of the angular velocity for a camera that looks down.
struct Stream {
  tf2::BufferCore tf;
  GroundReadings readings{tf};
  sensor_msgs::CameraInfo info;

  Stream() {
    GroundMotionConfig config = groundMotionDefaults();
    config.base_frame.clear();
    config.gyro = true;
    config.height_source = "range";
    readings.configure(config, "/range", "/imu");
    info.width = 640;
    info.height = 480;
    info.K = {500.0, 0.0, 320.0, 0.0, 500.0, 240.0, 0.0, 0.0, 1.0};
  }
  void addImu(double stamp, double rate) {
    sensor_msgs::Imu imu;
    imu.angular_velocity.z = rate;
    add(stamp, imu);
  }
  template <typename Reading>
  void add(double stamp, Reading& reading) {
    reading.header.frame_id = "cam";
    reading.header.stamp = ros::Time(stamp);
    readings.add(reading);
  }
  void addRange(double stamp) {
    sensor_msgs::Range range;
    range.max_range = 10.F;
    range.range = 2.F;
    add(stamp, range);
  }
  static std_msgs::Header image(double stamp) {
    std_msgs::Header header;
    header.frame_id = "cam";
    header.stamp = ros::Time(stamp);
    return header;
  }
  GroundFrame frame(double stamp) {
    HomographyStamped homography;
    homography.header = image(stamp);
    return readings.frameOf(homography, {640, 480}, info, Pixels::raw);
  }
};

/// The message about the rotation where all Imus are as this one.
std::string noTurnWith(sensor_msgs::Imu imu) {
  Stream stream;
  for (const double stamp : {1.0, 2.0}) {
    stream.add(stamp, imu);
    stream.frame(stamp);
  }
  return stream.readings.noTurn();
}

TEST(GroundReadings, StampsThatJitterLoseNoReading) {
  Stream stream;
  stream.frame(1.0);
  for (const double stamp : {1.01, 1.02, 1.04, 1.03, 1.07, 1.05})
    stream.addImu(stamp, 100.0 * (stamp - 1.0));
  EXPECT_TRUE(stream.readings.complete(stream.image(1.06)));
  const GroundFrame frame = stream.frame(1.06);
  ASSERT_TRUE(frame.turn);
  EXPECT_NEAR(Eigen::AngleAxisd(frame.turn->rotation).angle(), 0.06 * 3.0, 1e-6);
}

TEST(GroundReadings, ClockGoingBackRestarts) {
  Stream stream;
  stream.addImu(1000.0, 1.0);
  stream.addImu(0.8, 2.0);
  stream.addImu(1.0, 2.0);
  stream.frame(0.9);
  const GroundFrame frame = stream.frame(1.1);
  ASSERT_TRUE(frame.turn);
  EXPECT_NEAR(Eigen::AngleAxisd(frame.turn->rotation).angle(), 0.4, 1e-6);
}

TEST(GroundReadings, ASingleWrongStampLosesNoReading) {
  for (const double wrong : {0.0, 0.02, 1.9, 5.0, 1e6}) {
    Stream stream;
    stream.addImu(1.99, 9.0);
    stream.frame(2.0);
    const auto rate_at = [](double stamp) { return 100.0 * (stamp - 2.0); };
    for (const double stamp : {2.01, 2.02, 2.03}) {
      stream.addImu(stamp, rate_at(stamp));
      if (stamp == 2.02) stream.addImu(wrong, 3.0);
    }
    EXPECT_FALSE(stream.readings.complete(stream.image(2.05))) << wrong;
    for (const double stamp : {2.04, 2.05, 2.06}) stream.addImu(stamp, rate_at(stamp));
    EXPECT_TRUE(stream.readings.complete(stream.image(2.05))) << wrong;
    const GroundFrame frame = stream.frame(2.05);
    ASSERT_TRUE(frame.turn) << wrong;
    EXPECT_NEAR(Eigen::AngleAxisd(frame.turn->rotation).angle(), 0.05 * 3.0, 1e-6) << wrong;
  }
}

// Ages of more than 68 years do not fit into a ros::Duration.
TEST(GroundReadings, AnyStampIsComparedWithAnyOther) {
  constexpr double kLast = 4294967295.0;
  for (const double reading : {1.0, kLast}) {
    for (const double image : {1.0, 1.8e9, kLast}) {
      Stream stream;
      stream.addRange(reading);
      stream.addImu(reading, 1.0);
      EXPECT_NO_THROW(stream.frame(1.0)) << reading;
      EXPECT_NO_THROW(stream.frame(image)) << reading << ", " << image;
      EXPECT_NO_THROW(stream.readings.complete(stream.image(image))) << reading << ", " << image;
    }
  }
}

// A drawn map, say, of which K is not known.
TEST(GroundReadings, AReferenceOfAnotherSizeIsRefused) {
  Stream stream;
  HomographyStamped h;
  h.header = Stream::image(1.0);
  h.status = MatchStatus::STATUS_OK;
  h.homography[0] = h.homography[4] = h.homography[8] = 1.0;
  h.image_width = h.reference_width = 640;
  h.image_height = h.reference_height = 480;
  const auto use = [&] { stream.readings.frameOf(h, {640, 480}, stream.info, Pixels::raw); };
  EXPECT_EQ(test::refusalOf(use), "");
  h.reference_width = h.reference_height = 1000;
  test::expectSays(test::refusalOf(use),
                   "from a reference of 1000x1000 to images of 640x480; expected a reference by "
                   "the same camera");
}

// A gimbal, or a joint_state_publisher: the transform after the image comes later than its match.
TEST(GroundReadings, WaitsForEachTransformThatAnImageNeeds) {
  struct Case {
    const char* base_frame;
    const char* height_source;
    const char* normal_source;
    const char* moving;  // the frame that tf moves
  };
  for (const Case& each :
       {Case{"base", "parameter", "down", "base"}, Case{"", "range", "down", "sonar"},
        Case{"", "parameter", "imu", "imu"}, Case{"", "tf_height", "down", "ground"},
        Case{"", "parameter", "tf_normal", "ground"}}) {
    Stream stream;
    GroundMotionConfig config = groundMotionDefaults();
    config.base_frame = each.base_frame;
    config.height_source = each.height_source;
    config.normal_source = each.normal_source;
    stream.readings.configure(config, "/range", "/imu");
    sensor_msgs::Range range;
    range.header.frame_id = "sonar";
    sensor_msgs::Imu imu;
    imu.header.frame_id = "imu";
    range.header.stamp = imu.header.stamp = ros::Time(1.03);
    stream.readings.add(range);
    stream.readings.add(imu);
    const auto send = [&](double stamp) {
      geometry_msgs::TransformStamped transform;
      transform.header = Stream::image(stamp);
      transform.child_frame_id = each.moving;
      transform.transform.rotation.w = 1.0;
      stream.tf.setTransform(transform, "test");
    };
    send(1.0);
    EXPECT_FALSE(stream.readings.complete(Stream::image(1.02))) << each.moving;
    send(1.05);
    EXPECT_TRUE(stream.readings.complete(Stream::image(1.02))) << each.moving;
  }
}

TEST(GroundReadings, RangeCountsOnceWhereUsed) {
  Stream stream;
  stream.addRange(1.0);
  const auto estimate_is = [&](GroundStatus status) {
    GroundEstimate estimate{};
    estimate.status = status;
    stream.readings.withPatience(estimate);
  };
  EXPECT_TRUE(stream.frame(1.0).height);
  estimate_is(GroundStatus::no_homography);
  EXPECT_TRUE(stream.frame(1.03).height);  // the frame before could not use it
  estimate_is(GroundStatus::ok);
  EXPECT_FALSE(stream.frame(1.06).height);
}

// Each orientation then serves several images, which together count as one reading.
TEST(GroundReadings, AnImuSlowerThanTheCameraCountsLess) {
  for (const double rate : {10.0, 30.0, 200.0}) {
    Stream stream;
    GroundMotionConfig config = groundMotionDefaults();
    config.base_frame.clear();
    config.normal_source = "imu";
    stream.readings.configure(config, "/range", "/imu");
    sensor_msgs::Imu imu;
    imu.orientation.w = 1.0;
    imu.orientation_covariance[0] = imu.orientation_covariance[4] = 0.01 * 0.01;
    for (int i = 0; i < 2.0 * rate; ++i) stream.add(1.0 + i / rate, imu);
    stream.frame(1.9);
    for (int i = 1; i < 20; ++i) {
      const GroundFrame frame = stream.frame(1.9 + i / 30.0);
      ASSERT_TRUE(frame.down);
      const double uses = std::max(1.0, 30.0 / rate);
      EXPECT_NEAR(frame.down->deviation, std::sqrt(uses) * 0.01, 1e-6) << rate << " " << i;
    }
  }
}

// The message that is nearest may be later than the image, for which complete() has waited.
TEST(GroundReadings, ARangeNeedsNoTransformLaterThanTheImage) {
  Stream stream;
  sensor_msgs::Range range;
  range.header.frame_id = "sonar";
  range.header.stamp = ros::Time(1.03);
  range.max_range = 10.F;
  range.range = 2.F;
  stream.readings.add(range);
  stream.addImu(1.03, 0.0);
  for (const double stamp : {1.0, 1.025}) {
    geometry_msgs::TransformStamped transform;
    transform.header = Stream::image(stamp);
    transform.child_frame_id = "sonar";
    transform.transform.rotation.w = std::sqrt(0.5);
    transform.transform.rotation.y = -std::sqrt(0.5);  // its beam is the optical axis
    stream.tf.setTransform(transform, "test");
  }
  EXPECT_TRUE(stream.readings.complete(Stream::image(1.02)));
  EXPECT_TRUE(stream.frame(1.02).height);
}

TEST(GroundReadings, AnImuWithoutAnAngularVelocityIsNamed) {
  sensor_msgs::Imu imu;
  EXPECT_EQ(noTurnWith(imu), "");
  imu.angular_velocity.y = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(noTurnWith(imu), "the angular velocity on /imu has a number that is not finite");
  imu.angular_velocity_covariance[0] = -1.0;
  EXPECT_EQ(
      noTurnWith(imu),
      "the angular_velocity_covariance on /imu begins with -1, so it has no angular velocity");
}

TEST(PoseMessage, BadPoseOrCovarianceIsRefused) {
  using Pose = geometry_msgs::PoseWithCovariance;
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  const std::string indefinite =
      "the covariance is none: it is not symmetric, or not positive semidefinite";
  const std::vector<std::pair<std::string, std::function<void(Pose&)>>> changes{
      {"", [](Pose&) {}},
      {"", [](Pose& p) { p.covariance[0] = p.covariance[35] = 1.7e308; }},
      {"",
       [](Pose& p) {
         p.covariance[0] = p.covariance[1] = p.covariance[6] = p.covariance[7] = 4.0;
       }},
      {indefinite, [](Pose& p) { p.covariance[1] = p.covariance[6] = 9.0; }},
      {indefinite, [](Pose& p) { p.covariance[0] = -1.0; }},
      {indefinite,
       [](Pose& p) {
         p.covariance[0] = p.covariance[7] = 1.0;
         p.covariance[1] = 0.5;
       }},
      {"the covariance has a number that is not finite", [](Pose& p) { p.covariance[20] = kNan; }},
      {"the position has a number that is not finite", [](Pose& p) { p.pose.position.y = kNan; }},
      {"the orientation has a length of", [](Pose& p) { p.pose.orientation.w = kNan; }}};
  for (const auto& [words, change] : changes) {
    Pose pose;
    pose.pose.orientation.w = 1.0;
    change(pose);
    const std::string error = test::refusalOf([&] {
      poseOf(pose.pose);
      covarianceOf(pose);
    });
    EXPECT_EQ(error.find(words), 0U) << words << " | " << error;
    EXPECT_EQ(error.empty(), words.empty()) << error;
  }
}

}  // namespace
}  // namespace ktgp_orb
