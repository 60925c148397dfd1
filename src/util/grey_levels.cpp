#include "util/grey_levels.h"

#include <cstdint>
#include <utility>
#include <vector>

namespace ktgp_orb::util {
namespace {

constexpr int kValues = 65536;

/// Returns the darkest and the brightest grey value of the image, without the extremes: at most
/// `ignored` pixels are darker than the first value, and at most `ignored` pixels are brighter than
/// the second.
std::pair<int, int> endsWithout(double ignored, const cv::Mat& image) {
  std::vector<std::uint32_t> histogram(kValues, 0);
  for (int y = 0; y < image.rows; ++y) {
    const auto* row = image.ptr<std::uint16_t>(y);
    for (int x = 0; x < image.cols; ++x) ++histogram[row[x]];
  }
  int low = 0;
  for (double below = histogram[0]; below <= ignored && low + 1 < kValues;) {
    below += histogram[static_cast<std::size_t>(++low)];
  }
  int high = kValues - 1;
  for (double above = histogram[kValues - 1]; above <= ignored && high > low;) {
    above += histogram[static_cast<std::size_t>(--high)];
  }
  return {low, high};
}

}  // namespace

cv::Mat stretchTo8Bit(const cv::Mat& image, GreyStretch stretch) {
  constexpr double kIgnored = 0.001;
  std::pair<int, int> ends(0, kValues - 1);
  if (stretch == GreyStretch::percentile) {
    ends = endsWithout(kIgnored * static_cast<double>(image.total()), image);
  }
  const auto [low, high] = ends;
  const double scale = high > low ? 255.0 / (high - low) : 0.0;
  cv::Mat stretched;
  image.convertTo(stretched, CV_8U, scale, -scale * low);
  return stretched;
}

}  // namespace ktgp_orb::util
