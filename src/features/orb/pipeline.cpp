#include "features/orb/pipeline.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/features2d.hpp>
#include <utility>

#include "util/constants.h"
#include "util/divide.h"
#include "util/shared_matrix.h"

namespace ktgp_orb::orb {
namespace {

using util::ceilDivide;

// Width of the border of the blurred image that no descriptor reads, px.
constexpr int kBlurMargin = kEdgeMargin - kPatternRadius;
constexpr int kBandRows = 64;  // rows that one task processes if there are several threads
constexpr int kKeypointsPerTask = 64;

// Resizes `descriptors` to one row per keypoint. Reuses the memory if it is large enough and not
// shared. `data` is checked, too, because a matrix has a size but no memory after a failed
// allocation.
void resizeDescriptors(int rows, int capacity, cv::Mat& descriptors) {
  if (util::isShared(descriptors) || descriptors.data == nullptr || descriptors.type() != CV_8UC1 ||
      descriptors.cols != kDescriptorBytes) {
    descriptors.release();
    descriptors.create(std::max(rows, capacity), kDescriptorBytes, CV_8U);
  }
  descriptors.resize(static_cast<std::size_t>(rows));
}

// Blurs the rows [first_row, last_row) of `image` with a 7x7 Gaussian of sigma 2 into `blurred`,
// except for kBlurMargin pixels on each side. The rows must keep this distance from the border,
// too. `blurred` has the size of `image`, plus 64 bytes per row.
//
// The arithmetic equals cv::ORB on a processor with fused multiply-add: single precision, one
// rounding per term. (On a processor without it, OpenCV 4.6 rounds twice per term, which changes
// about three pixels in a million by one grey value. This function always rounds once.)
void blurRows(const cv::Mat& image, int first_row, int last_row, const OrbKernels& kernels,
              cv::Mat& scratch, cv::Mat& blurred) {
  constexpr int kBlurredRows = 2 * kBlurRadius + 1;
  const int columns = image.cols - 2 * kBlurMargin;
  // Every row starts on a cache line, which holds 16 values, because a load across two lines takes
  // twice as long.
  const int pitch = ceilDivide(columns + kVectorSlack, 16) * 16;
  // After a failed allocation a matrix has a size but no memory.
  if (scratch.cols < pitch || scratch.data == nullptr) scratch.create(kBlurredRows, pitch, CV_32F);
  const auto along = [&](int y) { return scratch.ptr<float>(y % kBlurredRows); };
  for (int y = first_row - kBlurRadius; y < last_row + kBlurRadius; ++y) {
    kernels.blur_along_row(image.ptr<std::uint8_t>(y) + kBlurMargin, columns, along(y));
    const int middle = y - kBlurRadius;
    if (middle < first_row) continue;
    const float* rows[kBlurredRows];
    for (int i = 0; i < kBlurredRows; ++i) rows[i] = along(middle - kBlurRadius + i);
    kernels.blur_across_rows(rows, columns, blurred.ptr<std::uint8_t>(middle) + kBlurMargin);
  }
}

}  // namespace

OrbPipeline::OrbPipeline(const OrbOptions& options, const OrbKernels& kernels)
    : options_(options),
      kernels_(kernels),
      pool_(options.threads),
      pyramid_(options.max_features, static_cast<float>(options.scale_factor), options.levels,
               options.first_level),
      levels_(options.levels),
      uniform_choice_(options.max_features, options.fast_threshold, options.keypoints_per_cell,
                      options.levels) {
  if (options.descriptor == DescriptorKind::teblid) {
    std::vector<float> sizes;
    for (const PyramidLevel& level : pyramid_.levels()) sizes.push_back(kPatchSize * level.scale);
    teblid_.emplace(std::move(sizes), kernels);
  }
}

bool OrbPipeline::extract(const cv::Mat& image, const cv::Mat& mask, Features& features) {
  pyramid_.setImage(image, mask);
  if (pyramid_.used() == 0) return false;
  if (options_.images != ImageKeeping::none) pyramid_.takeBuffers(features.images);
  cutIntoBands();
  // The image and the larger levels are complete already, so the other threads can start on them
  // while one thread computes the smaller levels.
  const int ready = levels_[std::min(options_.first_level, pyramid_.used() - 1)].last_band;
  pool_.parallelFor(2 + ready, [&](int i) {
    if (i == 0) {
      pyramid_.shrink(kernels_);
    } else if (i == 1) {
      if (teblid_) teblid_->setImage(image);
    } else {
      detectAndBlur(bands_[i - 2]);
    }
  });
  pool_.parallelFor(levels_[pyramid_.used() - 1].last_band - ready,
                    [&](int i) { detectAndBlur(bands_[ready + i]); });
  if (options_.fast_adaptive) detectWeaker();
  if (options_.distribution == KeypointDistribution::uniform) {
    chooseUniform();
  } else {
    chooseRanked();
  }
  gather(features);
  const auto count = static_cast<int>(features.size());
  pool_.parallelFor(ceilDivide(count, kKeypointsPerTask), [&](int task) {
    const int begin = task * kKeypointsPerTask;
    const int end = std::min(count, begin + kKeypointsPerTask);
    orientAndDescribe(begin, end, features);
  });
  if (options_.images != ImageKeeping::none) {
    pyramid_.handOut(options_.images == ImageKeeping::copy, features.images);
  }
  return true;
}

void OrbPipeline::cutIntoBands() {
  std::size_t used = 0;
  for (int level = 0; level < pyramid_.used(); ++level) {
    const cv::Size size = pyramid_.levels()[level].size;
    const int rows = size.height - 2 * kBlurMargin;
    const int count = pool_.threads() == 1 ? 1 : ceilDivide(rows, kBandRows);
    levels_[level].first_band = static_cast<int>(used);
    for (int i = 0; i < count; ++i, ++used) {
      if (bands_.size() == used) bands_.emplace_back();
      bands_[used].level = level;
      bands_[used].first_row = kBlurMargin + rows * i / count;
      bands_[used].last_row = kBlurMargin + rows * (i + 1) / count;
    }
    levels_[level].last_band = static_cast<int>(used);
    if (!teblid_) levels_[level].blurred.create(size.height, size.width + kVectorSlack, CV_8U);
  }
}

/// The FAST threshold of the first detection. For a uniform distribution, it is half of the
/// threshold in the options, because parts of the image with few corners keep weaker corners, too.
int OrbPipeline::fullThreshold() const {
  constexpr int kWeaker = 2;
  return options_.distribution == KeypointDistribution::ranked
             ? options_.fast_threshold
             : std::max(1, options_.fast_threshold / kWeaker);
}

void OrbPipeline::detect(Band& band, int threshold) {
  const cv::Mat& image = pyramid_.levels()[band.level].image;
  band.corners.clear();
  const int first = std::max(band.first_row, kEdgeMargin);
  const int last = std::min(band.last_row, image.rows - kEdgeMargin);
  if (first >= last) return;
  fastCorners(image, first, last, threshold, kernels_, band.fast_scratch, band.corners);
}

void OrbPipeline::detectAndBlur(Band& band) {
  detect(band, fullThreshold());
  if (teblid_) return;  // TEBLID compares means of boxes, which need no blur
  blurRows(pyramid_.levels()[band.level].image, band.first_row, band.last_row, kernels_,
           band.blurred_rows, levels_[band.level].blurred);
}

/// If the frame has few corners, for example because it is dark or blurred, detects again with half
/// of the threshold, then with a quarter of it, and so on.
void OrbPipeline::detectWeaker() {
  constexpr int kFew = 4;      // a frame has few corners if it has fewer than max_features / kFew
  constexpr int kWeakest = 5;  // grey values; corners below this threshold are noise
  const int bands = levels_[pyramid_.used() - 1].last_band;
  const auto has_few = [&] {
    std::size_t corners = 0;
    for (int i = 0; i < bands; ++i) corners += bands_[i].corners.size();
    return kFew * corners < static_cast<std::size_t>(options_.max_features);
  };
  int threshold = fullThreshold();
  while (threshold > kWeakest && has_few()) {
    threshold = std::max(kWeakest, threshold / 2);
    pool_.parallelFor(bands, [&](int i) { detect(bands_[i], threshold); });
  }
}

void OrbPipeline::collectCorners(int level) {
  std::vector<cv::KeyPoint>& keypoints = levels_[level].keypoints;
  keypoints.clear();
  std::swap(keypoints, bands_[levels_[level].first_band].corners);
  for (int i = levels_[level].first_band + 1; i < levels_[level].last_band; ++i) {
    keypoints.insert(keypoints.end(), bands_[i].corners.begin(), bands_[i].corners.end());
  }
  cv::KeyPointsFilter::runByPixelsMask(keypoints, pyramid_.levels()[level].mask);
}

void OrbPipeline::chooseRanked() {
  pool_.parallelFor(pyramid_.used(), [&](int level) {
    collectCorners(level);
    const PyramidLevel& source = pyramid_.levels()[level];
    std::vector<cv::KeyPoint>& keypoints = levels_[level].keypoints;
    // The FAST score is an inaccurate measure of a corner's quality. So we use it only to preselect
    // twice the wanted number of corners.
    cv::KeyPointsFilter::retainBest(keypoints, 2 * source.features_quota);
    for (cv::KeyPoint& keypoint : keypoints) {
      keypoint.response = harrisResponse(source.image, kernels_, keypoint.pt);
    }
    cv::KeyPointsFilter::retainBest(keypoints, source.features_quota);
  });
}

void OrbPipeline::chooseUniform() {
  pool_.parallelFor(pyramid_.used(), [&](int level) {
    collectCorners(level);
    const PyramidLevel& source = pyramid_.levels()[level];
    uniform_choice_.sortIntoCells(level, source.size, source.features_quota,
                                  levels_[level].keypoints);
  });
  uniform_choice_.share(pyramid_.used());
  pool_.parallelFor(pyramid_.used(), [&](int level) {
    uniform_choice_.keepShares(level, pyramid_.levels()[level].image, kernels_,
                               levels_[level].keypoints);
  });
}

void OrbPipeline::gather(Features& features) {
  for (int level = 0; level < pyramid_.used(); ++level) {
    for (cv::KeyPoint& keypoint : levels_[level].keypoints) {
      keypoint.octave = level;
      keypoint.size = kPatchSize * pyramid_.levels()[level].scale;
      features.keypoints.push_back(keypoint);
    }
  }
  resizeDescriptors(static_cast<int>(features.size()), options_.max_features, features.descriptors);
}

// All directions are computed before all descriptors. Each direction is a long chain of dependent
// operations. In a loop of its own, the processor can interleave the chains of several keypoints.
void OrbPipeline::orientAndDescribe(int begin, int end, Features& features) {
  std::array<cv::Point2f, kKeypointsPerTask> directions;
  for (int i = begin; i < end; ++i) {
    cv::KeyPoint& keypoint = features.keypoints[i];
    keypoint.angle =
        intensityCentroidAngle(pyramid_.levels()[keypoint.octave].image, kernels_, keypoint.pt);
    const float angle = keypoint.angle * static_cast<float>(util::kPi / 180.);
    directions[i - begin] = cv::Point2f(std::cos(angle), std::sin(angle));
  }
  for (int i = begin; i < end; ++i) {
    describe(features.keypoints[i], directions[i - begin], features.descriptors.ptr(i));
  }
}

void OrbPipeline::describe(cv::KeyPoint& keypoint, const cv::Point2f& direction,
                           std::uint8_t* descriptor) {
  const cv::Point2f place = keypoint.pt;
  keypoint.pt *= pyramid_.levels()[keypoint.octave].scale;
  if (teblid_) {
    teblid_->describe(keypoint, descriptor);
    return;
  }
  const cv::Mat& blurred = levels_[keypoint.octave].blurred;
  kernels_.describe(pixelAt(blurred, place), static_cast<std::ptrdiff_t>(blurred.step), direction.x,
                    direction.y, descriptor);
}

}  // namespace ktgp_orb::orb
