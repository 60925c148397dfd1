#pragma once

#include <fuzzer/FuzzedDataProvider.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "ktgp_orb/ktgp_matcher.h"
#include "ktgp_orb/orb_extractor.h"

/// What the fuzz targets share. The bytes that libFuzzer hands in first choose sizes and options;
/// what is large (images, descriptors) grows from a seed and the bytes that are left.
namespace ktgp_orb::fuzz {

using Input = FuzzedDataProvider;

/// An invariant: ends the program, and so the fuzzing, where it does not hold.
inline void require(bool holds, const char* what) {
  if (holds) return;
  std::fprintf(stderr, "invariant broken: %s\n", what);
  std::abort();
}

/// Any double, but ordinary ones as often as odd ones.
inline double anyDouble(Input& in, double low, double high) {
  constexpr double kOdd[] = {0.0,
                             -0.0,
                             1e-300,
                             1e300,
                             -1e9,
                             std::numeric_limits<double>::quiet_NaN(),
                             std::numeric_limits<double>::infinity()};
  if (in.ConsumeIntegralInRange(0, 63) == 0) return kOdd[in.ConsumeIntegralInRange(0, 6)];
  return in.ConsumeFloatingPointInRange(low, high);
}

/// A picture with corners: random blocks, flat parts and the bytes that are left.
inline cv::Mat image(Input& in, const cv::Size& size, int stride_beyond = 0) {
  cv::Mat wide(size.height, size.width + stride_beyond, CV_8U);
  std::minstd_rand random(in.ConsumeIntegral<std::uint16_t>() + 1U);
  const int block = in.ConsumeIntegralInRange(1, 24);
  const int contrast = in.ConsumeIntegralInRange(0, 255);
  std::vector<std::uint8_t> values(1024);
  for (auto& value : values) value = static_cast<std::uint8_t>(random() % 256 * contrast / 255);
  const auto extra = in.ConsumeBytes<std::uint8_t>(in.ConsumeIntegralInRange(0, 512));
  std::copy(extra.begin(), extra.end(), values.begin());
  for (int y = 0; y < wide.rows; ++y) {
    for (int x = 0; x < wide.cols; ++x) {
      wide.at<std::uint8_t>(y, x) =
          values[static_cast<std::size_t>(x / block + 37 * (y / block)) % values.size()];
    }
  }
  return wide.colRange(0, size.width);
}

/// Rows of 32 bytes, many of them nearly or quite equal.
inline cv::Mat descriptors(Input& in, int rows) {
  cv::Mat all(rows, kDescriptorBytes, CV_8U);
  std::minstd_rand random(in.ConsumeIntegral<std::uint16_t>() + 1U);
  const unsigned kinds = in.ConsumeIntegralInRange(1U, 300U);
  const unsigned flips = in.ConsumeIntegralInRange(0U, 40U);
  for (int i = 0; i < rows; ++i) {
    std::minstd_rand kind(random() % kinds + 1);
    for (int b = 0; b < kDescriptorBytes; ++b)
      all.at<std::uint8_t>(i, b) = static_cast<std::uint8_t>(kind() >> 8);
    for (unsigned f = random() % (flips + 1); f > 0; --f) {
      all.at<std::uint8_t>(i, static_cast<int>(random() % 32)) ^=
          static_cast<std::uint8_t>(1U << random() % 8);
    }
  }
  return all;
}

/// A keypoint position: mostly within, at times on or beyond the border.
inline float coordinate(Input& in, int size) {
  const float within = in.ConsumeFloatingPointInRange(0.0F, static_cast<float>(size));
  switch (in.ConsumeIntegralInRange(0, 31)) {
    case 0:
      return static_cast<float>(size);
    case 1:
      return -within;
    case 2:
      return within * 1e6F;
    case 3:
      return static_cast<float>(anyDouble(in, -1e38, 1e38));
    default:
      return within;
  }
}

/// Keypoints that follow a homography, or none; as a deserialised message would hold them.
inline Features features(Input& in, int most) {
  Features out;
  out.image_size = {in.ConsumeIntegralInRange(1, 2000), in.ConsumeIntegralInRange(1, 2000)};
  const int count = in.ConsumeIntegralInRange(0, most);
  const bool listed = in.ConsumeBool();
  std::minstd_rand random(in.ConsumeIntegral<std::uint16_t>() + 1U);
  for (int i = 0; i < count; ++i) {
    cv::KeyPoint keypoint;
    keypoint.pt = listed ? cv::Point2f(coordinate(in, out.image_size.width),
                                       coordinate(in, out.image_size.height))
                         : cv::Point2f(static_cast<float>(random() % 16384) / 16384.0F *
                                           static_cast<float>(out.image_size.width),
                                       static_cast<float>(random() % 16384) / 16384.0F *
                                           static_cast<float>(out.image_size.height));
    keypoint.octave = listed ? in.ConsumeIntegralInRange(-2, 20) : static_cast<int>(random() % 8);
    keypoint.angle = static_cast<float>(random() % 360);
    keypoint.size = 31.0F * static_cast<float>(std::pow(1.2, random() % 8));
    out.keypoints.push_back(keypoint);
  }
  out.descriptors = descriptors(in, count);
  return out;
}

inline MatcherOptions matcherOptions(Input& in) {
  MatcherOptions options = in.ConsumeBool() ? MatcherOptions::ktgp() : MatcherOptions::robust();
  options.ratio_threshold = in.ConsumeFloatingPointInRange(0.05, 1.0);
  options.mutual = in.ConsumeBool();
  options.gms.enabled = in.ConsumeBool();
  options.gms.threshold = in.ConsumeFloatingPointInRange(0.0, 8.0);
  options.gms.rotation = in.ConsumeBool();
  options.gms.scale = in.ConsumeBool();
  options.gms.grid_columns = in.ConsumeIntegralInRange(1, 40);
  options.gms.grid_rows = in.ConsumeIntegralInRange(1, 40);
  options.prosac.max_error = in.ConsumeFloatingPointInRange(0.1, 20.0);
  options.prosac.max_iterations = in.ConsumeIntegralInRange(1, 300);
  options.prosac.seed = in.ConsumeIntegral<std::uint8_t>();
  options.guided.enabled = in.ConsumeBool();
  options.guided.radius = in.ConsumeFloatingPointInRange(0.1, 100.0);
  options.guided.max_distance = in.ConsumeIntegralInRange(0, 256);
  options.alignment.enabled = in.ConsumeBool();
  options.alignment.points = in.ConsumeIntegralInRange(12, 400);
  return options;
}

/// Bytes as a file that no disk sees.
class MemoryFile {
 public:
  MemoryFile(const void* bytes, std::size_t size) : descriptor_(memfd_create("fuzz", 0)) {
    require(descriptor_ >= 0, "memfd_create");
    require(write(descriptor_, bytes, size) == static_cast<ssize_t>(size), "write");
  }
  ~MemoryFile() { close(descriptor_); }
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;
  std::string path() const { return "/proc/self/fd/" + std::to_string(descriptor_); }

 private:
  int descriptor_;
};

}  // namespace ktgp_orb::fuzz
