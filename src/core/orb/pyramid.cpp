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

// A mask pixel of a smaller level counts only if all its source pixels do.
void shrinkMask(const cv::Mat& finer, const cv::Size& size, cv::Mat& mask) {
  cv::resize(finer, mask, size, 0, 0, cv::INTER_LINEAR_EXACT);
  cv::threshold(mask, mask, 254, 0, cv::THRESH_TOZERO);
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

OrbPyramid::OrbPyramid(int features, double scale_factor, int levels)
    : levels_(levels), shrinkers_(levels - 1) {
  const std::vector<int> quota = featuresPerLevel(features, scale_factor, levels);
  for (int i = 0; i < levels; ++i) {
    levels_[i].scale = static_cast<float>(std::pow(scale_factor, i));
    levels_[i].features_quota = quota[i];
  }
}

void OrbPyramid::setImage(const cv::Mat& image, const cv::Mat& mask) {
  levels_[0].image = image;
  levels_[0].mask = mask;
  used_ = 0;
  for (PyramidLevel& level : levels_) {
    level.size = cv::Size(scaled(image.cols, level.scale), scaled(image.rows, level.scale));
    if (std::min(level.size.width, level.size.height) <= 2 * kEdgeMargin) break;
    ++used_;
  }
}

void OrbPyramid::shrink(const OrbKernels& kernels) {
  for (int i = 1; i < used_; ++i) {
    const PyramidLevel& finer = levels_[i - 1];
    PyramidLevel& level = levels_[i];
    shrinkers_[i - 1].shrink(finer.image, level.size, kernels, level.image);
    if (finer.mask.empty()) {
      level.mask.release();
    } else {
      shrinkMask(finer.mask, level.size, level.mask);
    }
  }
}

void OrbPyramid::takeBuffers(std::vector<cv::Mat>& images) {
  for (std::size_t i = 1; i < levels_.size(); ++i) {
    levels_[i].image.release();
    if (i < images.size() && isSoleOwner(images[i])) cv::swap(levels_[i].image, images[i]);
  }
}

void OrbPyramid::handOut(bool copy_first, std::vector<cv::Mat>& images) const {
  images.resize(static_cast<std::size_t>(used_));
  if (copy_first) {
    if (!isSoleOwner(images[0])) images[0].release();
    levels_[0].image.copyTo(images[0]);
  } else {
    images[0] = levels_[0].image;
  }
  for (std::size_t i = 1; i < images.size(); ++i) images[i] = levels_[i].image;
}

}  // namespace ktgp_orb::orb
