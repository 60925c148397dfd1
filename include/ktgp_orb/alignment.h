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

/// Options of the sub-pixel alignment (class Alignment).
struct AlignmentOptions {
  bool enabled = true;  ///< if false, the given homography is not changed
  int points = 400;     ///< maximum number of correspondences to align, 12..100000
};

/// Outcome of the alignment.
enum class AlignmentStatus : std::uint8_t {
  not_run = 0,         ///< alignment is off, or there was no homography to start from
  ok = 1,              ///< the answer is the aligned homography
  no_images = 2,       ///< a frame has no images (see OrbOptions::images)
  too_few_points = 3,  ///< fewer than 12 points could be aligned
  not_better = 4,      ///< the keypoints determine the homography better than the aligned points
};

/// Returns the enumerator's name, e.g. "too_few_points".
const char* toString(AlignmentStatus status);

/// A point of the reference near a keypoint, and the position that alignment found for it in the
/// target, both in px. The point is at most one pixel of its pyramid level away from the keypoint.
struct AlignedPoint {
  std::size_t match = 0;              ///< index of the correspondence in `matches` of align()
  std::int32_t reference_index = -1;  ///< index of the reference keypoint of the correspondence
  std::int32_t target_index = -1;
  Eigen::Vector2d reference = Eigen::Vector2d::Zero();
  Eigen::Vector2d target = Eigen::Vector2d::Zero();
  double correlation = 0.0;  ///< squared normalised cross-correlation of the patches, 0.5..1
};

/// Result of Alignment::align. If you reuse it for the next call, it keeps its buffers.
struct AlignmentResult {
  AlignmentStatus status = AlignmentStatus::not_run;
  UncertainHomography answer;  ///< the aligned homography if the status is ok, else the given one
  std::vector<AlignedPoint> points;  ///< the points that could be aligned, in order of `match`
  /// Number of points that align() tried to align; the counts below say why some of them failed.
  std::size_t tried = 0;
  std::size_t outside = 0;  ///< number of points whose patch or search window leaves an image
  /// Number of points at which H mirrors, compresses or stretches the patch too much.
  std::size_t distorted = 0;
  /// Number of patches with too little texture, in one direction or both.
  std::size_t textureless = 0;
  std::size_t unsettled = 0;  ///< number of points at which the iteration did not converge
  /// Number of patches that moved away from the predicted position by more than 4 px of their
  /// pyramid level.
  std::size_t beyond_reach = 0;
  std::size_t uncorrelated = 0;  ///< number of patches that look different at the new position
  /// Root mean square, over `points`, of the distance between the aligned position and the position
  /// that a homography predicts, px: the given homography for `rmse_before`, and `answer` for
  /// `rmse_after`.
  double rmse_before = 0.0;
  double rmse_after = 0.0;
};

/// Refines a homography with the images. Keypoints are accurate to half a pixel; the patches around
/// them can be registered to a few hundredths of a pixel.
///
/// Aligns up to AlignmentOptions::points correspondences, spread over the image, one by one. The
/// patch of 16x16 px around the reference keypoint is warped by the affine map that approximates H
/// at this keypoint. Inverse-compositional least squares (Baker & Matthews, IJCV 2004) find the
/// translation that brings the patch onto the target; the brightness may differ by a gain and a
/// bias. If the scene is more than 1.5 times as large in one image as in the other, alignment uses
/// a smaller pyramid level of the image in which the scene is larger, so that the scene has about
/// the same size in both images. Then H is estimated from the aligned points by maximum likelihood.
/// The fit assumes that the errors have a scale of at least a pixel (a third of `max_error`),
/// because no scene is exactly a plane: with a smaller scale, the fit would follow the part of the
/// scene with the most points. The answer is the aligned H, unless the homography from the
/// keypoints has a smaller uncertainty at the corners of the image.
///
/// The answer is the same for every instruction set.
///
/// An instance belongs to one thread at a time; several instances may work in parallel.
class Alignment {
 public:
  /// `max_error`: inlier threshold of the homography, px, > 0 (see ProsacOptions). The fit uses the
  /// aligned points that are within twice `max_error` of the positions that the homography
  /// predicts. It assumes that the scale of their errors is at least a third of `max_error`. Both
  /// limits are for images of 640x480 px and grow in proportion to the diagonal of the reference
  /// image. Throws std::invalid_argument, naming the option and its range, if an option is out of
  /// range.
  explicit Alignment(const AlignmentOptions& options = {},
                     double max_error = ProsacOptions().max_error);
  ~Alignment();
  Alignment(Alignment&&) noexcept;
  Alignment& operator=(Alignment&&) noexcept;

  const AlignmentOptions& options() const;

  /// Refines `start` (reference to target, px). `matches`: correspondences that agree with `start`.
  /// Throws std::invalid_argument if an index does not belong to a keypoint of the frame.
  void align(const Features& reference, const Features& target,
             const std::vector<Correspondence>& matches, const UncertainHomography& start,
             AlignmentResult& result);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ktgp_orb
