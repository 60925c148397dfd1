#include "core/orb/pyramid.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "core/util/shared_matrix.h"

namespace ktgp_orb::orb {
namespace {

// Half to even, like every rounding of a scaled length here.
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
    // A mask pixel of a smaller level counts only if all its source pixels do.
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
