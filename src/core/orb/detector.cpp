#include "core/orb/detector.h"

#include "core/orb/vector_angle.h"

namespace ktgp_orb::orb {

// Three rows of FAST scores move down the image. A row has one more score on each side than pixels
// are reported, for the neighbours of the first and the last.
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
    const std::uint8_t* row = scores(y) + 1;  // the score of column kEdgeMargin
    const int found = kernels.local_maxima(scores(y - 1) + 1, row, scores(y + 1) + 1, columns,
                                           scratch.maxima.data());
    for (int i = 0; i < found; ++i) {
      const int x = scratch.maxima[i];
      corners.emplace_back(static_cast<float>(kEdgeMargin + x), static_cast<float>(y), 7.f, -1.f,
                           static_cast<float>(row[x]));
    }
  }
}

float intensityCentroidAngle(const cv::Mat& image, const OrbKernels& kernels,
                             const cv::Point2f& point) {
  const Moments sum =
      kernels.moments(pixelAt(image, point), static_cast<std::ptrdiff_t>(image.step));
  return vectorAngle(static_cast<float>(sum.y), static_cast<float>(sum.x));
}

}  // namespace ktgp_orb::orb
