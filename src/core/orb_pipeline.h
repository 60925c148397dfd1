#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "ktgp_orb/features.h"
#include "ktgp_orb/orb_extractor.h"
#include "orb_blur.h"
#include "orb_detector.h"
#include "orb_pyramid.h"

namespace ktgp_orb {

/// The steps of ORB over all pyramid levels, cut into tasks for the threads.
class OrbPipeline {
 public:
  OrbPipeline(const OrbOptions& options, const OrbKernels& kernels);

  /// `image` and `mask` are valid (see OrbExtractor); `features` is empty but for its buffers.
  void extract(const cv::Mat& image, const cv::Mat& mask, Features& features);

 private:
  struct Level {
    cv::Mat blurred;
    std::vector<cv::KeyPoint> keypoints;
  };

  void detect(int level);
  void blur(int level);
  void describe(Features& features);

  OrbOptions options_;
  const OrbKernels& kernels_;
  OrbPyramid pyramid_;
  std::vector<Level> levels_;
  FastScratch fast_scratch_;
  BlurScratch blur_scratch_;
};

}  // namespace ktgp_orb
