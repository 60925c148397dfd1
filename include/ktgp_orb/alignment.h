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
  /// Inlier threshold of the homography, px, > 0; KtgpMatcher takes ProsacOptions::max_error. A
  /// keypoint agrees with the aligned homography within this, and the errors of the aligned points
  /// are never taken as smaller than a third of it. Both hold for images of 640x480 px and grow in
  /// proportion to the diagonal of the reference image.
  double max_error = 3.0;
};

/// What came of the alignment.
enum class AlignmentStatus : std::uint8_t {
  not_run = 0,         ///< switched off, or there was no homography to begin with
  ok = 1,              ///< the homography is the aligned one
  no_images = 2,       ///< a frame came without its images (see OrbOptions::images)
  too_few_points = 3,  ///< fewer than twelve points could be aligned
  not_better = 4,      ///< the aligned homography is not better supported than the one before
};

/// The enumerator's own name, e.g. "too_few_points".
const char* toString(AlignmentStatus status);

/// A point of the reference and where the target shows it, both in px. It lies within a pixel of
/// the keypoint, times the scale of the pyramid level it was aligned on.
struct AlignedPoint {
  std::size_t match = 0;  ///< the correspondence it stands for, a place in the list handed in
  std::int32_t reference_index = -1;  ///< keypoints of that correspondence
  std::int32_t target_index = -1;
  Eigen::Vector2d reference = Eigen::Vector2d::Zero();
  Eigen::Vector2d target = Eigen::Vector2d::Zero();
  double correlation = 0.0;  ///< squared normalised cross-correlation of the patches, 0.5..1
};

/// Reused from call to call for its buffers. Without status ok, homography and covariance are those
/// that were handed in.
struct AlignmentResult {
  AlignmentStatus status = AlignmentStatus::not_run;
  Eigen::Matrix3d homography = Eigen::Matrix3d::Zero();
  /// Of H's first eight entries, from the residuals of the aligned points, its shared part, and how
  /// far the scene is from a plane (see UncertainHomography).
  Covariance8 covariance = Covariance8::Zero();
  Covariance8 shared_covariance = Covariance8::Zero();
  double plane_deviation = 0.0;      ///< px
  std::vector<AlignedPoint> points;  ///< those that could be aligned, in order of `match`
  std::size_t tried = 0;             ///< points chosen; what became of the others:
  std::size_t outside = 0;           ///< the patch, or the room it may move in, leaves an image
  std::size_t distorted = 0;         ///< squeezed or stretched beyond use
  std::size_t textureless = 0;       ///< nothing says where it is, in one direction or both
  std::size_t unsettled = 0;         ///< the steps did not become small
  std::size_t beyond_reach = 0;      ///< moved farther than four px of its level
  std::size_t uncorrelated = 0;      ///< settled on something that looks different
  /// Root mean square over `points` of how far the homography handed in, and the one that came
  /// out, put them off their aligned positions, px.
  double rmse_before = 0.0;
  double rmse_after = 0.0;
};

/// Corrects a homography by the images. Keypoints are good to half a pixel; the patches around them
/// can be registered to a few hundredths.
///
/// Up to AlignmentOptions::points correspondences, spread over the image, are aligned each alone:
/// the 16x16 px around the reference keypoint, seen through the local affine part of H, are found
/// in the target by inverse-compositional least squares over a translation (Baker & Matthews, IJCV
/// 2004), whatever the gain and bias. Where H changes the scale by more than 1.5 the smaller image
/// is compared with the pyramid level of the larger that is nearest in scale. H is then estimated
/// again from the aligned points by maximum likelihood with a scale of at least a pixel (see
/// AlignmentOptions::max_error). No scene is exactly a plane: with a smaller scale the fit would
/// follow the part of the scene that has most points. The old H stays where the aligned points
/// scatter like keypoints (beyond a third of their variance).
///
/// The answer is the same for every instruction set.
///
/// An instance belongs to one thread at a time; several instances may run side by side.
class Alignment {
 public:
  /// Throws std::invalid_argument naming the option and its range.
  explicit Alignment(const AlignmentOptions& options = {});
  ~Alignment();
  Alignment(Alignment&&) noexcept;
  Alignment& operator=(Alignment&&) noexcept;

  const AlignmentOptions& options() const;

  /// `matches`: those that the homography of `start`, reference to target in px, explains; with
  /// indices into the frames' keypoints, else std::invalid_argument.
  void align(const Features& reference, const Features& target,
             const std::vector<Correspondence>& matches, const UncertainHomography& start,
             AlignmentResult& result);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ktgp_orb
