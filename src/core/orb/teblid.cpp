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

// A range of whole pixels, at least one, along one axis of the image.
struct Extent {
  int begin;
  int end;
  int length() const { return end - begin; }
};

Extent extentInImage(int centre, int radius, int size) {
  return {std::clamp(centre - radius, 0, size - 1), std::clamp(centre + radius + 1, 1, size)};
}

class BoxSums {
 public:
  explicit BoxSums(const cv::Mat& integral) : integral_(integral) {}

  std::int32_t sum(const Extent& columns, const Extent& rows) const {
    const auto* top = integral_.ptr<std::uint32_t>(rows.begin);
    const auto* bottom = integral_.ptr<std::uint32_t>(rows.end);
    // Unsigned, since the sums of a large image overflow; their differences are still right.
    return static_cast<std::int32_t>(top[columns.begin] + bottom[columns.end] - top[columns.end] -
                                     bottom[columns.begin]);
  }

  std::int32_t sum(const cv::Point& centre, int radius) const {
    return sum({centre.x - radius, centre.x + radius + 1},
               {centre.y - radius, centre.y + radius + 1});
  }

  float meanInImage(const cv::Point& centre, int radius) const {
    const Extent columns = extentInImage(centre.x, radius, integral_.cols - 1);
    const Extent rows = extentInImage(centre.y, radius, integral_.rows - 1);
    return static_cast<float>(sum(columns, rows)) /
           static_cast<float>(columns.length() * rows.length());
  }

 private:
  const cv::Mat& integral_;
};

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
  const BoxSums boxes(integral);
  std::fill_n(descriptor, kTeblidBits / 8, std::uint8_t{0});
  for (int i = 0; i < kTeblidBits; ++i) {
    const cv::Point first = placed(placement, kTeblidTable.first_x[i], kTeblidTable.first_y[i]);
    const cv::Point second = placed(placement, kTeblidTable.second_x[i], kTeblidTable.second_y[i]);
    const int radius = std::max(0, toPixel(placement.scale * kTeblidTable.radius[i]));
    const float threshold = kTeblidTable.threshold[i];
    bool bit;
    if (inside) {  // both boxes have the same number of pixels: compare the sums
      const int area = (2 * radius + 1) * (2 * radius + 1);
      bit = static_cast<float>(boxes.sum(first, radius) - boxes.sum(second, radius)) <=
            threshold * static_cast<float>(area);
    } else {
      bit = boxes.meanInImage(first, radius) - boxes.meanInImage(second, radius) <= threshold;
    }
    if (bit) descriptor[i / 8] |= static_cast<std::uint8_t>(0x80 >> (i % 8));
  }
}

}  // namespace ktgp_orb::orb
