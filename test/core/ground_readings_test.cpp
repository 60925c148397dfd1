#include "messages/ground_readings.h"

#include <dynamic_reconfigure/Config.h>
#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <sstream>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "messages/pose_message.h"

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

TEST(GroundReadings, DefaultsAreThoseOfTheNode) {
  const std::string expected = textOf(GroundMotionConfig::__getDefault__());
  EXPECT_NE(expected.find("height_deviation"), std::string::npos);
  EXPECT_EQ(textOf(groundMotionDefaults()), expected);
}

TEST(PoseMessage, WhatIsNoPoseOrNoCovarianceIsRefused) {
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
    std::string error;
    try {
      poseOf(pose.pose);
      covarianceOf(pose);
    } catch (const std::invalid_argument& refused) {
      error = refused.what();
    }
    EXPECT_EQ(error.find(words), 0U) << words << " | " << error;
    EXPECT_EQ(error.empty(), words.empty()) << error;
  }
}

}  // namespace
}  // namespace ktgp_orb
