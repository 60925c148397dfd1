#include "core/orb/detector.h"

#include <algorithm>

#include "core/orb/vector_angle.h"

namespace ktgp_orb::orb {
namespace {

// Three rows of FAST scores that move down the image. A row has one more score on each side than
// pixels are reported, for the neighbours of the first and the last.
class ScoreRows {
 public:
  ScoreRows(const cv::Mat& image, int threshold, const OrbKernels& kernels, FastScratch& scratch)
      : image_(image),
        threshold_(threshold),
        kernels_(kernels),
        count_(image.cols - 2 * kEdgeMargin + 2),
        pitch_(count_ + kVectorSlack) {
    scratch.scores.resize(3 * static_cast<std::size_t>(pitch_));
    scores_ = scratch.scores.data();
  }

  void compute(int y) {
    kernels_.fast_scores(image_.ptr<std::uint8_t>(y) + kEdgeMargin - 1,
                         static_cast<std::ptrdiff_t>(image_.step), count_, threshold_, row(y));
  }

  // The score of column kEdgeMargin.
  const std::uint8_t* first(int y) const { return row(y) + 1; }

 private:
  std::uint8_t* row(int y) const { return scores_ + static_cast<std::ptrdiff_t>(y % 3) * pitch_; }

  const cv::Mat& image_;
  int threshold_;
  const OrbKernels& kernels_;
  int count_;
  int pitch_;
  std::uint8_t* scores_;
};

}  // namespace

void fastCorners(const cv::Mat& image, int first_row, int last_row, int threshold,
                 const OrbKernels& kernels, FastScratch& scratch,
                 std::vector<cv::KeyPoint>& corners) {
  const int columns = image.cols - 2 * kEdgeMargin;
  ScoreRows scores(image, threshold, kernels, scratch);
  scratch.maxima.resize(static_cast<std::size_t>(columns) + 3);
  scores.compute(first_row - 1);
  scores.compute(first_row);
  for (int y = first_row; y < last_row; ++y) {
    scores.compute(y + 1);
    const std::uint8_t* row = scores.first(y);
    const int found = kernels.local_maxima(scores.first(y - 1), row, scores.first(y + 1), columns,
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
