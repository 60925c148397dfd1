#pragma once

#include <time.h>

#include <cstdlib>
#include <optional>
#include <string>

namespace ktgp_orb::bench {

/// CPU time of one thread (other programs do not disturb it), or wall-clock time for more.
inline double milliseconds(bool one_thread) {
  timespec time{};
  clock_gettime(one_thread ? CLOCK_THREAD_CPUTIME_ID : CLOCK_MONOTONIC, &time);
  return 1e3 * static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_nsec);
}

/// The Oxford sets below the folder named by KTGP_ORB_DATA; empty if it is not set.
inline std::optional<std::string> oxfordFolder() {
  const char* data = std::getenv("KTGP_ORB_DATA");
  if (data == nullptr || *data == '\0') return std::nullopt;
  return std::string(data) + "/oxford";
}

/// Image 1 to 6 of a set ("leuven", "bikes", "boat").
inline std::string oxfordImage(const std::string& folder, const std::string& set, int number) {
  return folder + "/" + set + "/img" + std::to_string(number) + (set == "boat" ? ".pgm" : ".ppm");
}

/// The file with the homography from image 1 of a set to image `number`.
inline std::string oxfordTruth(const std::string& folder, const std::string& set, int number) {
  return folder + "/" + set + "/H1to" + std::to_string(number) + "p";
}

}  // namespace ktgp_orb::bench
