#pragma once

#include <fuzzer/FuzzedDataProvider.h>
#include <sys/mman.h>
#include <unistd.h>

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "ktgp_orb/ktgp_matcher.h"
#include "ktgp_orb/orb_extractor.h"
#include "util/random.h"

/// Common code of the fuzz targets. The bytes from libFuzzer first choose sizes and options; large
/// data (images, descriptors) is generated from a seed and the remaining bytes.
namespace ktgp_orb::fuzz {

using Input = FuzzedDataProvider;

/// An invariant: ends the program, and the fuzzing, if it does not hold.
inline void require(bool holds, const char* what) {
  if (holds) return;
  std::fprintf(stderr, "invariant broken: %s\n", what);
  std::abort();
}

/// Changes some bits of a descriptor.
inline void flipBits(std::uint8_t* descriptor, unsigned count, util::Random& random) {
  for (; count > 0; --count) {
    const std::uint32_t bit = random.below(8 * kDescriptorBytes);
    descriptor[bit / 8] ^= static_cast<std::uint8_t>(1U << bit % 8);
  }
}

/// Any double, ordinary values as often as unusual ones.
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

/// Mostly near the identity; its shift in px.
inline Eigen::Matrix3d homography(Input& in, double shift, double linear = 0.3,
                                  double perspective = 1e-3) {
  Eigen::Matrix3d h = Eigen::Matrix3d::Identity();
  for (int i = 0; i < 9; ++i) {
    const double unit = i % 3 == 2 && i < 8 ? shift : (i < 6 ? linear : perspective);
    h(i / 3, i % 3) += anyDouble(in, -unit, unit);
  }
  return h;
}

/// Mostly few, sometimes up to `most`: small inputs find most and are fast.
inline int few(Input& in, int most) {
  const int eighth = in.ConsumeIntegralInRange(0, 7);
  return in.ConsumeIntegralInRange(0, eighth == 0 ? most : most / (eighth < 3 ? 4 : 16));
}

/// Mostly one.
inline int threads(Input& in) {
  return in.ConsumeIntegralInRange(0, 63) == 0 ? 2 : 1;
}

/// A picture with corners: random blocks, flat parts and the remaining bytes.
inline cv::Mat image(Input& in, const cv::Size& size, int stride_beyond = 0) {
  cv::Mat wide(size.height, size.width + stride_beyond, CV_8U);
  util::Random random(in.ConsumeIntegral<std::uint16_t>());
  const int block = in.ConsumeIntegralInRange(1, 24);
  const unsigned contrast = in.ConsumeIntegral<std::uint8_t>();
  std::array<std::uint8_t, 1024> values;
  for (auto& value : values) value = static_cast<std::uint8_t>(random.below(contrast + 1));
  const int given = in.ConsumeIntegralInRange(0, 512);
  in.ConsumeData(values.data(), static_cast<std::size_t>(given));
  for (int y = 0; y < wide.rows; ++y) {
    std::uint8_t* row = wide.ptr(y);
    if (y % block != 0) {
      std::copy_n(wide.ptr(y - 1), wide.cols, row);
      continue;
    }
    auto value = static_cast<std::size_t>(37 * (y / block));
    for (int x = 0; x < wide.cols; x += block) {
      std::fill_n(row + x, std::min(block, wide.cols - x), values[value++ % values.size()]);
    }
  }
  return wide.colRange(0, size.width);
}

/// A picture and its pyramid, each level in its own memory without spare room.
inline std::vector<cv::Mat> pyramid(Input& in, const cv::Size& size) {
  std::vector<cv::Mat> levels{image(in, size)};
  const int count = in.ConsumeIntegralInRange(1, 8);
  double scale = 1.0;
  while (static_cast<int>(levels.size()) < count) {
    scale /= 1.2;
    const cv::Size smaller(std::max(1, static_cast<int>(size.width * scale)),
                           std::max(1, static_cast<int>(size.height * scale)));
    levels.emplace_back();
    cv::resize(levels[0], levels.back(), smaller, 0.0, 0.0, cv::INTER_LINEAR);
  }
  return levels;
}

/// Rows of 32 bytes, many of them equal or nearly equal.
inline cv::Mat descriptors(Input& in, int rows) {
  cv::Mat all(rows, kDescriptorBytes, CV_8U);
  util::Random random(in.ConsumeIntegral<std::uint16_t>());
  const unsigned kinds = in.ConsumeIntegralInRange(1U, 300U);
  const unsigned flips = in.ConsumeIntegralInRange(0U, 40U);
  for (int i = 0; i < rows; ++i) {
    util::Random kind(random.below(kinds));
    for (int b = 0; b < kDescriptorBytes; b += 8) {
      const std::uint64_t bits = kind.next();
      std::memcpy(all.ptr(i) + b, &bits, sizeof(bits));
    }
    flipBits(all.ptr(i), random.below(flips + 1), random);
  }
  return all;
}

/// A keypoint position: mostly inside, sometimes on or beyond the border.
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

/// Features as in a deserialised message: random, or given by the bytes one by one.
inline Features features(Input& in, int most) {
  Features out;
  out.image_size = {in.ConsumeIntegralInRange(1, 2000), in.ConsumeIntegralInRange(1, 2000)};
  const int count = few(in, most);
  const bool listed = in.ConsumeBool();
  util::Random random(in.ConsumeIntegral<std::uint16_t>());
  const auto anywhere = [&](int size) {
    return static_cast<float>(random.below(16384)) / 16384.0F * static_cast<float>(size);
  };
  out.keypoints.resize(static_cast<std::size_t>(count));
  for (cv::KeyPoint& keypoint : out.keypoints) {
    keypoint.pt.x = listed ? coordinate(in, out.image_size.width) : anywhere(out.image_size.width);
    keypoint.pt.y =
        listed ? coordinate(in, out.image_size.height) : anywhere(out.image_size.height);
    keypoint.octave =
        listed ? in.ConsumeIntegralInRange(-2, 20) : static_cast<int>(random.below(8));
    keypoint.angle = static_cast<float>(random.below(360));
    keypoint.size = 31.0F * static_cast<float>(1U + random.below(4));
  }
  out.descriptors = descriptors(in, count);
  return out;
}

/// Whether all keypoints lie in the image.
inline bool isWithin(const Features& features) {
  return std::all_of(features.keypoints.begin(), features.keypoints.end(), [&](const auto& k) {
    return k.pt.x >= 0.0F && k.pt.y >= 0.0F &&
           k.pt.x < static_cast<float>(features.image_size.width) &&
           k.pt.y < static_cast<float>(features.image_size.height);
  });
}

inline MatcherOptions matcherOptions(Input& in) {
  MatcherOptions options = in.ConsumeBool() ? MatcherOptions::ktgp() : MatcherOptions::robust();
  options.knn.threads = threads(in);
  options.knn.search_radius = in.ConsumeBool() ? in.ConsumeFloatingPointInRange(1.0, 300.0) : 0.0;
  options.ratio_threshold = in.ConsumeFloatingPointInRange(0.05, 1.0);
  options.mutual = in.ConsumeBool();
  options.gms.enabled = in.ConsumeBool();
  options.gms.threshold = in.ConsumeFloatingPointInRange(0.0, 8.0);
  options.gms.rotation = in.ConsumeBool();
  options.gms.scale = in.ConsumeBool();
  options.gms.grid_columns = 1 + few(in, 100);
  options.gms.grid_rows = 1 + few(in, 100);
  options.prosac.max_error = in.ConsumeFloatingPointInRange(0.1, 20.0);
  options.prosac.max_iterations = 1 + few(in, 600);
  options.prosac.seed = in.ConsumeIntegral<std::uint8_t>();
  options.guided.enabled = in.ConsumeBool();
  options.guided.radius = in.ConsumeFloatingPointInRange(0.1, 100.0);
  options.guided.max_distance = in.ConsumeIntegralInRange(0, 256);
  options.alignment.enabled = in.ConsumeBool();
  options.alignment.points = in.ConsumeIntegralInRange(12, 400);
  return options;
}

/// Bytes as a file in memory; one at a time. Its folder has nothing else, so other files that it
/// names do not exist.
class MemoryFile {
 public:
  MemoryFile(const void* bytes, std::size_t size) {
    require(ftruncate(place().descriptor, 0) == 0, "ftruncate");
    require(pwrite(place().descriptor, bytes, size, 0) == static_cast<ssize_t>(size), "pwrite");
  }
  std::string path() const { return place().link; }

 private:
  struct Place {
    Place() {
      require(descriptor >= 0, "memfd_create");
      require(mkdtemp(folder.data()) != nullptr, "mkdtemp");
      link = folder + "/input";
      const std::string memory = "/proc/self/fd/" + std::to_string(descriptor);
      require(symlink(memory.c_str(), link.c_str()) == 0, "symlink");
    }
    ~Place() {
      unlink(link.c_str());
      rmdir(folder.c_str());
    }
    int descriptor = memfd_create("fuzz", 0);
    std::string folder = "/tmp/ktgp_orb_fuzz_XXXXXX";
    std::string link;
  };

  static Place& place() {
    static Place one;
    return one;
  }
};

}  // namespace ktgp_orb::fuzz

/// Defines libFuzzer's function: `run` with each input. It may refuse an input, as documented, by
/// std::invalid_argument.
#define KTGP_ORB_FUZZ(run)                                                             \
  extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) { \
    ktgp_orb::fuzz::Input in(bytes, size);                                             \
    try {                                                                              \
      run(in);                                                                         \
    } catch (const std::invalid_argument&) {                                           \
    }                                                                                  \
    return 0;                                                                          \
  }
