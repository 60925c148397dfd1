#pragma once

#include <cstdlib>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <string>

namespace ktgp_orb::test {

/// Folder named by an environment variable; empty if it is unset, and the test is skipped.
inline std::optional<std::string> folderFrom(const char* variable) {
  const char* value = std::getenv(variable);
  if (value == nullptr || *value == '\0') return std::nullopt;
  return std::string(value);
}

/// Real images and bags (KTGP_ORB_DATA).
inline std::optional<std::string> dataFolder() {
  return folderFrom("KTGP_ORB_DATA");
}

/// Images of a set of the Oxford data in dataFolder(), grey.
inline cv::Mat oxfordImage(const std::string& set, int number) {
  const std::string suffix = set == "boat" ? ".pgm" : ".ppm";
  return cv::imread(*dataFolder() + "/oxford/" + set + "/img" + std::to_string(number) + suffix,
                    cv::IMREAD_GRAYSCALE);
}

/// Reference results of other implementations (KTGP_ORB_ORACLE).
inline std::optional<std::string> oracleFolder() {
  return folderFrom("KTGP_ORB_ORACLE");
}

/// Photographs: those of Debian's package opencv-doc, or of the folder KTGP_ORB_PHOTOS.
inline std::optional<std::string> photoFolder() {
  if (const auto folder = folderFrom("KTGP_ORB_PHOTOS")) return folder;
  const std::string debian = "/usr/share/doc/opencv-doc/examples/data";
  if (!std::ifstream(debian + "/graf1.png")) return std::nullopt;
  return debian;
}

}  // namespace ktgp_orb::test

/// Skips the running test with a message unless the folder exists.
#define KTGP_ORB_REQUIRE_FOLDER(folder, variable) \
  if (!(folder)) GTEST_SKIP() << variable << " is not set: this test needs it"
