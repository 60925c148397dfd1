#pragma once

#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "features/orb/detector.h"
#include "features/orb/pyramid.h"
#include "features/orb/teblid.h"
#include "features/orb/uniform.h"
#include "ktgp_orb/features.h"
#include "ktgp_orb/orb_extractor.h"
#include "util/thread_pool.h"

namespace ktgp_orb::orb {

/// The steps of ORB over all pyramid levels, divided into tasks for the threads. The result does
/// not depend on which thread runs which task.
class OrbPipeline {
 public:
  OrbPipeline(const OrbOptions& options, const OrbKernels& kernels);

  const OrbOptions& options() const { return options_; }

  /// Extracts the features. `image` and `mask` must be valid (see OrbExtractor), and `features`
  /// must not contain keypoints. Returns false if no pyramid level is large enough for a patch.
  bool extract(const cv::Mat& image, const cv::Mat& mask, Features& features);

 private:
  /// Rows of one pyramid level, and the buffers of the task that finds their corners and blurs
  /// them.
  struct Band {
    int level = 0;
    int first_row = 0;
    int last_row = 0;
    std::vector<cv::KeyPoint> corners;
    FastScratch fast_scratch;
    cv::Mat blurred_rows;  ///< buffer of blurRows()
  };
  struct Level {
    cv::Mat blurred;
    std::vector<cv::KeyPoint> keypoints;  ///< positions in px of the level
    int first_band = 0;
    int last_band = 0;
  };

  void cutIntoBands();
  int fullThreshold() const;
  void detect(Band& band, int threshold);
  void detectAndBlur(Band& band);
  void detectWeaker();
  void chooseRanked();
  void chooseUniform();
  void collectCorners(int level);
  void gather(Features& features);
  void orientAndDescribe(int begin, int end, Features& features);
  void describe(cv::KeyPoint& keypoint, const cv::Point2f& direction, std::uint8_t* descriptor);

  OrbOptions options_;
  const OrbKernels& kernels_;
  util::ThreadPool pool_;
  OrbPyramid pyramid_;
  std::optional<TeblidDescriber> teblid_;  // empty if the descriptors are rBRIEF
  std::vector<Level> levels_;
  std::vector<Band> bands_;  // sorted by level, and from top to bottom within a level
  UniformChoice uniform_choice_;
};

}  // namespace ktgp_orb::orb
