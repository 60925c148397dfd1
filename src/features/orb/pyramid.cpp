#include "features/orb/pyramid.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "util/divide.h"
#include "util/shared_matrix.h"

namespace ktgp_orb::orb {
namespace {

using util::ceilDivide;

constexpr int kReach = 16;  // number of source pixels that a narrow block loads

// For target pixel i, returns the index of the first of its two source pixels, and the weight of
// the second in units of 1/256. Pixel centres are at half-integers. Outside the outermost centres,
// the edge pixel is repeated.
std::pair<int, int> tapAt(int i, int source, int target) {
  const double scale = 1.0 / (static_cast<double>(target) / source);
  const double position = scale * (i + 0.5) - 0.5;
  const int first = cvFloor(position);
  if (first < 0) return {0, 0};
  if (first >= source - 1) return {source - 1, 0};
  return {first, cvRound((position - first) * 256)};
}

// Returns a length divided by `scale`, rounded (halves to even). The sizes of all levels of the
// pyramid are computed in this way.
int scaled(int length, float scale) {
  return cvRound(length * (1.f / scale));
}

void resizeMask(const cv::Mat& source, PyramidLevel& level) {
  if (source.empty()) {
    level.mask.release();
  } else {
    cv::resize(source, level.mask, level.size, 0, 0, cv::INTER_LINEAR_EXACT);
  }
}

bool isSoleOwner(const cv::Mat& image) {
  return image.u != nullptr && !util::isShared(image);
}

}  // namespace

ResizeAxis::ResizeAxis(int source_length, int target_length)
    : source(source_length), target(target_length), narrow(source_length >= kReach) {
  blocks.resize(static_cast<std::size_t>(ceilDivide(target, kResizeBlock)));
  for (std::size_t b = 0; b < blocks.size(); ++b) {
    ResizeBlock& block = blocks[b];
    const int begin = static_cast<int>(b) * kResizeBlock;
    // The last block of a row starts further left, so that it does not read past the end of the
    // row.
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
  const int slot = row % 2;  // the two rows in use are neighbours, so they have different slots
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
    // The buffers grow first, so that the sizes remain consistent if the allocation throws.
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

std::vector<int> featuresPerLevel(int features, double scale_factor, int levels) {
  const auto factor = static_cast<float>(1.0 / scale_factor);
  float wanted = features * (1 - factor) /
                 (1 - static_cast<float>(std::pow(static_cast<double>(factor), levels)));
  std::vector<int> result(levels);
  int left = features;
  for (int level = 0; level < levels - 1; ++level) {
    result[level] = cvRound(wanted);
    left -= result[level];
    wanted *= factor;
  }
  result[levels - 1] = std::max(left, 0);
  return result;
}

OrbPyramid::OrbPyramid(int features, double scale_factor, int levels, int first_level)
    : levels_(levels), shrinkers_(levels - 1), first_level_(first_level) {
  const std::vector<int> quota = featuresPerLevel(features, scale_factor, levels);
  for (int i = 0; i < levels; ++i) {
    levels_[i].scale = static_cast<float>(std::pow(scale_factor, i - first_level));
    levels_[i].features_quota = quota[i];
  }
}

void OrbPyramid::setImage(const cv::Mat& image, const cv::Mat& mask) {
  levels_[first_level_].image = image;
  levels_[first_level_].mask = mask;
  used_ = 0;
  for (PyramidLevel& level : levels_) {
    level.size = cv::Size(scaled(image.cols, level.scale), scaled(image.rows, level.scale));
    if (std::min(level.size.width, level.size.height) <= 2 * kEdgeMargin) break;
    ++used_;
  }
  for (int i = 0; i < std::min(first_level_, used_); ++i) {
    cv::resize(image, levels_[i].image, levels_[i].size, 0, 0, cv::INTER_LINEAR_EXACT);
    resizeMask(mask, levels_[i]);
  }
}

void OrbPyramid::shrink(const OrbKernels& kernels) {
  for (int i = first_level_ + 1; i < used_; ++i) {
    const PyramidLevel& finer = levels_[i - 1];
    PyramidLevel& level = levels_[i];
    shrinkers_[i - 1].shrink(finer.image, level.size, kernels, level.image);
    resizeMask(finer.mask, level);
    // A mask pixel of a smaller level is set only if all its source pixels are set.
    if (!level.mask.empty()) cv::threshold(level.mask, level.mask, 254, 0, cv::THRESH_TOZERO);
  }
}

void OrbPyramid::takeBuffers(std::vector<cv::Mat>& images) {
  const auto first = static_cast<std::size_t>(first_level_);
  for (std::size_t i = 1; first + i < levels_.size(); ++i) {
    cv::Mat& level = levels_[first + i].image;
    level.release();
    if (i < images.size() && isSoleOwner(images[i])) cv::swap(level, images[i]);
  }
}

void OrbPyramid::handOut(bool copy_first, std::vector<cv::Mat>& images) const {
  const PyramidLevel* const levels = levels_.data() + first_level_;
  images.resize(static_cast<std::size_t>(std::max(1, used_ - first_level_)));
  if (copy_first) {
    if (!isSoleOwner(images[0])) images[0].release();
    levels[0].image.copyTo(images[0]);
  } else {
    images[0] = levels[0].image;
  }
  for (std::size_t i = 1; i < images.size(); ++i) images[i] = levels[i].image;
}

}  // namespace ktgp_orb::orb
