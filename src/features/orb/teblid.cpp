#include "features/orb/teblid.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <utility>

namespace ktgp_orb::orb {
namespace {

// Rounds to the nearest pixel by truncating v + 0.5, so that halves are rounded up. NaN, and values
// far outside any image, give a pixel far outside.
int toPixel(float v) {
  constexpr float kFar = 1e8f;
  v += 0.5f;
  if (!(v > -kFar)) return static_cast<int>(-kFar);
  return static_cast<int>(std::min(v, kFar));
}

// The part of a box that is inside an image of `size` px, along one axis; at least one pixel.
cv::Range rangeInImage(int centre, int radius, int size) {
  return {std::clamp(centre - radius, 0, size - 1), std::clamp(centre + radius + 1, 1, size)};
}

std::int32_t boxSum(const cv::Mat& integral, const cv::Range& columns, const cv::Range& rows) {
  const auto* top = integral.ptr<std::uint32_t>(rows.start);
  const auto* bottom = integral.ptr<std::uint32_t>(rows.end);
  // The sums are unsigned, because they may overflow; the differences of the sums are still right.
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

TeblidScale::TeblidScale(float size, int row) : keypoint_size(size), stride(row), corners{} {
  float area[kTeblidRadii + 1] = {};
  for (int radius = 1; radius <= kTeblidRadii; ++radius) {
    const int r = static_cast<int>(size / kTeblidPatch * static_cast<float>(radius) + kTeblidHalf);
    const std::ptrdiff_t above = static_cast<std::ptrdiff_t>(-r) * stride;
    const std::ptrdiff_t below = static_cast<std::ptrdiff_t>(r + 1) * stride;
    corners[radius] = {above - r, above + r + 1, below - r, below + r + 1};
    const auto side = static_cast<float>(2 * r + 1);
    area[radius] = side * side;
  }
  for (int bit = 0; bit < kTeblidBits; ++bit) {
    // Limits the bound, because the conversion to an integer would overflow on the highest levels,
    // where a box may be larger than any image. No keypoint is found on such levels.
    constexpr float kMost = 1 << 30;
    const float difference =
        std::floor(kTeblidTable.threshold[bit] * area[kTeblidTable.radius[bit]]);
    bound[teblidPlace(bit)] = static_cast<std::int32_t>(std::clamp(difference, -kMost, kMost)) + 1;
  }
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
    if (inside) {  // both boxes have the same number of pixels, so we compare sums, not means
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

TeblidDescriber::TeblidDescriber(std::vector<float> sizes, const OrbKernels& kernels)
    : sizes_(std::move(sizes)), kernels_(&kernels) {
  scales_.reserve(sizes_.size());
}

void TeblidDescriber::setImage(const cv::Mat& image) {
  cv::integral(image, integral_, CV_32S);
  const auto stride = static_cast<int>(integral_.step1());
  if (!scales_.empty() && scales_.front().stride == stride) return;
  scales_.clear();
  for (const float size : sizes_) scales_.emplace_back(size, stride);
}

void TeblidDescriber::describe(const cv::KeyPoint& keypoint, std::uint8_t* descriptor) const {
  const auto octave = static_cast<std::size_t>(keypoint.octave);
  const bool prepared = octave < scales_.size() && scales_[octave].keypoint_size == keypoint.size &&
                        isFarFromBorder(keypoint, {integral_.cols - 1, integral_.rows - 1});
  if (prepared) {
    kernels_->describe_teblid(integral_.ptr<std::uint32_t>(), scales_[octave],
                              TeblidPlacement(keypoint), descriptor);
  } else {
    describeTeblid(integral_, keypoint, descriptor);
  }
}

}  // namespace ktgp_orb::orb
