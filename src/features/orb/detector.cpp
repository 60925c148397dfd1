#include "features/orb/detector.h"

#include <algorithm>
#include <cfloat>
#include <cmath>

#include "util/constants.h"

namespace ktgp_orb::orb {
namespace {

constexpr auto kDegrees = static_cast<float>(180 / util::kPi);

// Arc tangent of a ratio in [0, 1], in degrees.
float arcTangent(float ratio) {
  constexpr float kP1 = 0.9997878412794807f * kDegrees;
  constexpr float kP3 = -0.3258083974640975f * kDegrees;
  constexpr float kP5 = 0.1555786518463281f * kDegrees;
  constexpr float kP7 = -0.04432655554792128f * kDegrees;
  const float square = ratio * ratio;
  return (((kP7 * square + kP5) * square + kP3) * square + kP1) * ratio;
}

// Returns `whole` - `angle` if `wanted`, else `angle`; `angle` must not be negative. There is no
// branch, because the processor would often mispredict it.
float reflected(float angle, float whole, bool wanted) {
  const float sign[] = {1.f, -1.f};
  const float base[] = {0.f, whole};
  return base[static_cast<int>(wanted)] + sign[static_cast<int>(wanted)] * angle;
}

}  // namespace

// Only the scores of three rows of the image are kept at a time. A row has one extra score on each
// side, since the first and the last reported pixel need neighbours.
void fastCorners(const cv::Mat& image, int first_row, int last_row, int threshold,
                 const OrbKernels& kernels, FastScratch& scratch,
                 std::vector<cv::KeyPoint>& corners) {
  const int columns = image.cols - 2 * kEdgeMargin;
  const std::ptrdiff_t pitch = columns + 2 + kVectorSlack;
  scratch.scores.resize(3 * static_cast<std::size_t>(pitch));
  scratch.maxima.resize(static_cast<std::size_t>(columns) + 3);
  const auto scores = [&](int y) { return scratch.scores.data() + y % 3 * pitch; };
  const auto compute = [&](int y) {
    kernels.fast_scores(image.ptr<std::uint8_t>(y) + kEdgeMargin - 1,
                        static_cast<std::ptrdiff_t>(image.step), columns + 2, threshold, scores(y));
  };
  compute(first_row - 1);
  compute(first_row);
  for (int y = first_row; y < last_row; ++y) {
    compute(y + 1);
    const std::uint8_t* row = scores(y) + 1;  // points to the score of column kEdgeMargin
    const int found = kernels.local_maxima(scores(y - 1) + 1, row, scores(y + 1) + 1, columns,
                                           scratch.maxima.data());
    for (int i = 0; i < found; ++i) {
      const int x = scratch.maxima[i];
      corners.emplace_back(static_cast<float>(kEdgeMargin + x), static_cast<float>(y), 7.f, -1.f,
                           static_cast<float>(row[x]));
    }
  }
}

float vectorAngle(float y, float x) {
  const float width = std::abs(x);
  const float height = std::abs(y);
  const bool is_flat = width >= height;
  // DBL_EPSILON avoids a division by zero for the null vector. It changes no other result.
  const float ratio =
      std::min(width, height) / (std::max(width, height) + static_cast<float>(DBL_EPSILON));
  const float angle = reflected(arcTangent(ratio), 90.f, !is_flat);
  return reflected(reflected(angle, 180.f, x < 0), 360.f, y < 0);
}

float intensityCentroidAngle(const cv::Mat& image, const OrbKernels& kernels,
                             const cv::Point2f& point) {
  const auto [x, y] =
      kernels.moments(pixelAt(image, point), static_cast<std::ptrdiff_t>(image.step));
  return vectorAngle(static_cast<float>(y), static_cast<float>(x));
}

}  // namespace ktgp_orb::orb
