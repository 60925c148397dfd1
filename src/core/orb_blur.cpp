#include "orb_blur.h"

namespace ktgp_orb {
namespace {

constexpr int kRows = 2 * kBlurRadius + 1;
constexpr int kVectorSlack = 64;  // what the kernels may touch beyond the end of a row

}  // namespace

void blurRows(const cv::Mat& image, int first_row, int last_row, const OrbKernels& kernels,
              BlurScratch& scratch, cv::Mat& blurred) {
  const int columns = image.cols - 2 * kBlurMargin;
  const std::ptrdiff_t pitch = columns + kVectorSlack;
  scratch.resize(kRows * static_cast<std::size_t>(pitch));
  const auto along = [&](int y) { return scratch.data() + y % kRows * pitch; };
  for (int y = first_row - kBlurRadius; y < last_row + kBlurRadius; ++y) {
    kernels.blurAlongRow(image.ptr<std::uint8_t>(y) + kBlurMargin, columns, along(y));
    const int middle = y - kBlurRadius;
    if (middle < first_row) continue;
    const float* rows[kRows];
    for (int i = 0; i < kRows; ++i) rows[i] = along(middle - kBlurRadius + i);
    kernels.blurAcrossRows(rows, columns, blurred.ptr<std::uint8_t>(middle) + kBlurMargin);
  }
}

}  // namespace ktgp_orb
