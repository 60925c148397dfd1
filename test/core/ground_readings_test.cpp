#include "messages/ground_readings.h"

#include <dynamic_reconfigure/Config.h>
#include <gtest/gtest.h>

#include <sstream>
#include <string>

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

}  // namespace
}  // namespace ktgp_orb
