#include "core/util/grey_levels.h"

#include <cstdint>
#include <stdexcept>
#include <utility>
#include <vector>

namespace ktgp_orb::util {
namespace {

constexpr int kValues = 65536;

/// The values below and above which `ignored` pixels lie.
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

void requireValid(const GreyStretch& stretch) {
  if (!(stretch.percentile >= 0.0 && stretch.percentile <= 49.0)) {
    throw std::invalid_argument("percentile of the stretch is " +
                                std::to_string(stretch.percentile) + "; expected 0 to 49");
  }
  if (stretch.low < 0 || stretch.high >= kValues || stretch.low >= stretch.high) {
    throw std::invalid_argument("low and high of the stretch are " + std::to_string(stretch.low) +
                                " and " + std::to_string(stretch.high) +
                                "; expected 0 <= low < high <= 65535");
  }
}

cv::Mat stretchTo8Bit(const cv::Mat& image, const GreyStretch& stretch) {
  std::pair<int, int> ends(stretch.low, stretch.high);
  if (stretch.kind == GreyStretch::Kind::percentile) {
    ends = endsWithout(stretch.percentile / 100.0 * static_cast<double>(image.total()), image);
  }
  const auto [low, high] = ends;
  const double scale = high > low ? 255.0 / (high - low) : 0.0;
  cv::Mat stretched;
  image.convertTo(stretched, CV_8U, scale, -scale * low);
  return stretched;
}

}  // namespace ktgp_orb::util
