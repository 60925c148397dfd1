#include "core/orb/teblid_describer.h"

#include <cmath>
#include <utility>

#include "core/orb/teblid.h"

namespace ktgp_orb::orb {

std::vector<float> keypointSizes(float patch, double scale_factor, int levels) {
  std::vector<float> sizes;
  sizes.reserve(static_cast<std::size_t>(levels));
  for (int i = 0; i < levels; ++i) {
    sizes.push_back(patch * static_cast<float>(std::pow(scale_factor, i)));
  }
  return sizes;
}

TeblidDescriber::TeblidDescriber(std::vector<float> sizes, const TeblidKernel& kernel)
    : sizes_(std::move(sizes)), kernel_(&kernel) {
  scales_.reserve(sizes_.size());
}

void TeblidDescriber::setImage(const cv::Mat& image) {
  integralImage(image, integral_);
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
    kernel_->describe(integral_.ptr<std::uint32_t>(), scales_[octave], TeblidPlacement(keypoint),
                      descriptor);
  } else {
    describeTeblid(integral_, keypoint, descriptor);
  }
}

}  // namespace ktgp_orb::orb
