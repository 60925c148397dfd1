#include "core/orb/blur.h"

#include "core/util/divide.h"

namespace ktgp_orb::orb {
namespace {

using util::ceilDivide;

constexpr int kRows = 2 * kBlurRadius + 1;

}  // namespace

void blurRows(const cv::Mat& image, int first_row, int last_row, const OrbKernels& kernels,
              BlurScratch& scratch, cv::Mat& blurred) {
  const int columns = image.cols - 2 * kBlurMargin;
  // Rows start on cache lines, 16 values each: a load across two lines takes twice as long.
  const int pitch = ceilDivide(columns + kVectorSlack, 16) * 16;
  // After a failed allocation a matrix has a size but no memory.
  if (scratch.cols < pitch || scratch.data == nullptr) scratch.create(kRows, pitch, CV_32F);
  const auto along = [&](int y) { return scratch.ptr<float>(y % kRows); };
  for (int y = first_row - kBlurRadius; y < last_row + kBlurRadius; ++y) {
    kernels.blur_along_row(image.ptr<std::uint8_t>(y) + kBlurMargin, columns, along(y));
    const int middle = y - kBlurRadius;
    if (middle < first_row) continue;
    const float* rows[kRows];
    for (int i = 0; i < kRows; ++i) rows[i] = along(middle - kBlurRadius + i);
    kernels.blur_across_rows(rows, columns, blurred.ptr<std::uint8_t>(middle) + kBlurMargin);
  }
}

}  // namespace ktgp_orb::orb
