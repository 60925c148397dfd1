#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/features.h"
#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb {

/// Options of the sub-pixel alignment.
struct AlignmentOptions {
  bool enabled = true;  ///< false: the homography stays PROSAC's
  int points = 400;     ///< correspondences that are aligned at most, 12..100000
};

/// Outcome of the alignment.
enum class AlignmentStatus : std::uint8_t {
  not_run = 0,         ///< not switched on, or there was no homography to start from
  ok = 1,              ///< the homography is the aligned one
  no_images = 2,       ///< a frame has no images (see OrbOptions::images)
  too_few_points = 3,  ///< fewer than twelve points could be aligned
  not_better = 4,      ///< the keypoints determine the homography better than the aligned points
};

/// The enumerator's own name, e.g. "too_few_points".
const char* toString(AlignmentStatus status);

/// A point of the reference and its position in the target, both in px. The position is at most one
/// pixel of the pyramid level from the keypoint.
struct AlignedPoint {
  std::size_t match = 0;              ///< its correspondence, an index into the given list
  std::int32_t reference_index = -1;  ///< keypoints of that correspondence
  std::int32_t target_index = -1;
  Eigen::Vector2d reference = Eigen::Vector2d::Zero();
  Eigen::Vector2d target = Eigen::Vector2d::Zero();
  double correlation = 0.0;  ///< squared normalised cross-correlation of the patches, 0.5..1
};

/// Reused from call to call for its buffers.
struct AlignmentResult {
  AlignmentStatus status = AlignmentStatus::not_run;
  UncertainHomography answer;        ///< unless the status is ok, the given one
  std::vector<AlignedPoint> points;  ///< the points that could be aligned, in order of `match`
  std::size_t tried = 0;  ///< points chosen; the following counts say why some could not be aligned
  std::size_t outside = 0;       ///< the patch, or its search window, leaves an image
  std::size_t distorted = 0;     ///< H compresses or stretches the patch too much
  std::size_t textureless = 0;   ///< the patch has too little texture, in one direction or both
  std::size_t unsettled = 0;     ///< the steps did not become small
  std::size_t beyond_reach = 0;  ///< moved farther than four px of its level
  std::size_t uncorrelated = 0;  ///< the patch found looks different
  /// Root mean square over `points` of the distance between the aligned position and the prediction
  /// of the given homography, and of the resulting one, px.
  double rmse_before = 0.0;
  double rmse_after = 0.0;
};

/// Corrects a homography by the images. Keypoints are good to half a pixel; the patches around them
/// can be registered to a few hundredths.
///
/// Aligns up to AlignmentOptions::points correspondences, spread over the image, one by one. The
/// 16x16 px around the reference keypoint, warped by the local affine part of H, are found in the
/// target by inverse-compositional least squares over a translation (Baker & Matthews, IJCV 2004),
/// with any gain and bias. Where H changes the scale by more than 1.5, the smaller image is
/// compared with the pyramid level of the larger one that is nearest in scale. Then H is estimated
/// from the aligned points by maximum likelihood, with a scale of the errors of at least a pixel
/// (a third of `max_error`): no scene is exactly a plane, and with a smaller scale the fit
/// would follow the part of the scene that has most points. The answer is the
/// aligned H unless the keypoints determine the corners of the image better.
///
/// The answer is the same for every instruction set.
///
/// An instance belongs to one thread at a time; several instances may run side by side.
class Alignment {
 public:
  /// `max_error`: inlier threshold of the homography, px, > 0 (see ProsacOptions). The fit uses
  /// aligned points within twice this error, and a scale of their errors of at least a third of it.
  /// Both hold for images of 640x480 px and grow in proportion to the diagonal of the reference
  /// image. Throws std::invalid_argument naming the option and its range.
  explicit Alignment(const AlignmentOptions& options = {},
                     double max_error = ProsacOptions().max_error);
  ~Alignment();
  Alignment(Alignment&&) noexcept;
  Alignment& operator=(Alignment&&) noexcept;

  const AlignmentOptions& options() const;

  /// `matches`: those that agree with the homography of `start` (reference to target, px), with
  /// indices into the frames' keypoints; otherwise std::invalid_argument.
  void align(const Features& reference, const Features& target,
             const std::vector<Correspondence>& matches, const UncertainHomography& start,
             AlignmentResult& result);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ktgp_orb
