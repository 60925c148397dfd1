#include "core/orb/resize.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/util/divide.h"

namespace ktgp_orb::orb {
namespace {

using util::ceilDivide;

constexpr int kReach = 16;  // source pixels that a narrow block loads

// The first of the two source pixels, and the weight of the next one in 1/256. Pixel centres are at
// half-integers; the edge pixel is repeated beyond the last centre.
std::pair<int, int> tapAt(int i, int source, int target) {
  const double scale = 1.0 / (static_cast<double>(target) / source);
  const double position = scale * (i + 0.5) - 0.5;
  const int first = cvFloor(position);
  if (first < 0) return {0, 0};
  if (first >= source - 1) return {source - 1, 0};
  return {first, cvRound((position - first) * 256)};
}

}  // namespace

ResizeAxis::ResizeAxis(int source_length, int target_length)
    : source(source_length), target(target_length), narrow(source_length >= kReach) {
  blocks.resize(static_cast<std::size_t>(ceilDivide(target, kResizeBlock)));
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    ResizeBlock& block = blocks[b];
    const int begin = static_cast<int>(b) * kResizeBlock;
    // The last block of a row starts earlier, so that it does not read past the end.
    block.start = std::min(tapAt(begin, source, target).first, std::max(source - kReach, 0));
    for (int i = 0; i < kResizeBlock; ++i) {
      const auto [first, weight] = tapAt(std::min(begin + i, target - 1), source, target);
      const int second = std::min(first + 1, source - 1);
      block.taps[i] = static_cast<std::uint8_t>(first - block.start);
      block.taps[kResizeBlock + i] = static_cast<std::uint8_t>(second - block.start);
      block.weights[i] = static_cast<std::uint16_t>(256 - weight);
      block.weights[kResizeBlock + i] = static_cast<std::uint16_t>(weight);
      narrow = narrow && second - block.start < kReach;
    }
  }
}

int ResizeAxis::firstTap(int i) const {
  const ResizeBlock& block = blocks[i / kResizeBlock];
  return block.start + block.taps[i % kResizeBlock];
}

int ResizeAxis::secondTap(int i) const {
  const ResizeBlock& block = blocks[i / kResizeBlock];
  return block.start + block.taps[kResizeBlock + i % kResizeBlock];
}

int ResizeAxis::secondWeight(int i) const {
  return blocks[i / kResizeBlock].weights[kResizeBlock + i % kResizeBlock];
}

const std::uint16_t* Shrinker::resizedRow(const cv::Mat& source, int row,
                                          const OrbKernels& kernels) {
  const int slot = row % 2;  // the two rows in use are neighbours
  if (buffered_row_[slot] != row) {
    const auto& resize = columns_.narrow ? kernels.resize_row : portableOrbKernels().resize_row;
    resize(source.ptr<std::uint8_t>(row), columns_.blocks.data(),
           static_cast<int>(columns_.blocks.size()), buffers_[slot].data());
    buffered_row_[slot] = row;
  }
  return buffers_[slot].data();
}

void Shrinker::shrink(const cv::Mat& source, const cv::Size& size, const OrbKernels& kernels,
                      cv::Mat& target) {
  if (columns_.source != source.cols || columns_.target != size.width) {
    ResizeAxis columns(source.cols, size.width);
    // First, so that the sizes stay consistent if memory runs out.
    for (auto& buffer : buffers_) {
      buffer.resize(columns.blocks.size() * kResizeBlock + kVectorSlack);
    }
    columns_ = std::move(columns);
  }
  if (rows_.source != source.rows || rows_.target != size.height) {
    rows_ = ResizeAxis(source.rows, size.height);
  }
  if (target.size() != size) {
    target = cv::Mat(size.height, size.width + kVectorSlack, CV_8U).colRange(0, size.width);
  }
  std::fill(std::begin(buffered_row_), std::end(buffered_row_), -1);
  for (int y = 0; y < size.height; ++y) {
    const std::uint16_t* above = resizedRow(source, rows_.firstTap(y), kernels);
    const std::uint16_t* below = resizedRow(source, rows_.secondTap(y), kernels);
    kernels.mix_rows(above, below, rows_.secondWeight(y), size.width, target.ptr<std::uint8_t>(y));
  }
}

}  // namespace ktgp_orb::orb
