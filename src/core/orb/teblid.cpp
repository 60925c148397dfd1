#include "core/orb/teblid.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>

#include "core/orb/teblid_geometry.h"
#include "core/orb/teblid_table.h"

namespace ktgp_orb::orb {
namespace {

// To the nearest pixel, halves up, by truncating v + 0.5. Values far outside any image, and NaN,
// stay outside.
int toPixel(float v) {
  constexpr float kFar = 1e8f;
  v += 0.5f;
  if (!(v > -kFar)) return static_cast<int>(-kFar);
  return static_cast<int>(std::min(v, kFar));
}

// The pixels along one axis of an image of that size, at least one.
cv::Range rangeInImage(int centre, int radius, int size) {
  return {std::clamp(centre - radius, 0, size - 1), std::clamp(centre + radius + 1, 1, size)};
}

std::int32_t boxSum(const cv::Mat& integral, const cv::Range& columns, const cv::Range& rows) {
  const auto* top = integral.ptr<std::uint32_t>(rows.start);
  const auto* bottom = integral.ptr<std::uint32_t>(rows.end);
  // Unsigned, since the sums of a large image overflow; their differences are still right.
  return static_cast<std::int32_t>(top[columns.start] + bottom[columns.end] - top[columns.end] -
                                   bottom[columns.start]);
}

std::int32_t boxSum(const cv::Mat& integral, const cv::Point& centre, int radius) {
  return boxSum(integral, {centre.x - radius, centre.x + radius + 1},
                {centre.y - radius, centre.y + radius + 1});
}

float meanInImage(const cv::Mat& integral, const cv::Point& centre, int radius) {
  const cv::Range columns = rangeInImage(centre.x, radius, integral.cols - 1);
  const cv::Range rows = rangeInImage(centre.y, radius, integral.rows - 1);
  return static_cast<float>(boxSum(integral, columns, rows)) /
         static_cast<float>(columns.size() * rows.size());
}

cv::Point placed(const TeblidPlacement& p, int u, int v) {
  const auto fu = static_cast<float>(u);
  const auto fv = static_cast<float>(v);
  return {toPixel(p.x_from_u * fu + p.x_from_v * fv + p.x),
          toPixel(p.y_from_u * fu + p.y_from_v * fv + p.y)};
}

}  // namespace

void integralImage(const cv::Mat& image, cv::Mat& integral) {
  cv::integral(image, integral, CV_32S);
}

void describeTeblid(const cv::Mat& integral, const cv::KeyPoint& keypoint,
                    std::uint8_t* descriptor) {
  const TeblidPlacement placement(keypoint);
  const bool inside = isFarFromBorder(keypoint, {integral.cols - 1, integral.rows - 1});
  std::fill_n(descriptor, kTeblidBits / 8, std::uint8_t{0});
  for (int i = 0; i < kTeblidBits; ++i) {
    const cv::Point first = placed(placement, kTeblidTable.first_x[i], kTeblidTable.first_y[i]);
    const cv::Point second = placed(placement, kTeblidTable.second_x[i], kTeblidTable.second_y[i]);
    const int radius = std::max(0, toPixel(placement.scale * kTeblidTable.radius[i]));
    const float threshold = kTeblidTable.threshold[i];
    bool bit;
    if (inside) {  // both boxes have the same number of pixels: compare the sums
      const int area = (2 * radius + 1) * (2 * radius + 1);
      bit =
          static_cast<float>(boxSum(integral, first, radius) - boxSum(integral, second, radius)) <=
          threshold * static_cast<float>(area);
    } else {
      bit =
          meanInImage(integral, first, radius) - meanInImage(integral, second, radius) <= threshold;
    }
    if (bit) descriptor[i / 8] |= static_cast<std::uint8_t>(0x80 >> (i % 8));
  }
}

}  // namespace ktgp_orb::orb
