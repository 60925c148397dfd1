#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <opencv2/core/types.hpp>
#include <tuple>
#include <vector>

#include "estimation/prosac.h"
#include "homography/point_pairs.h"
#include "homography/reprojection_fit.h"
#include "homography/smooth_field.h"
#include "homography/transform.h"
#include "ktgp_orb/prosac_homography.h"
#include "ktgp_orb/status.h"

namespace ktgp_orb::homography {

/// MSAC cost (Torr & Zisserman, CVIU 2000): sum over the pairs of min(e², limit²), where e is the
/// reprojection error in the target. If the sum exceeds `give_up`, the loop ends early and returns
/// the partial sum. So a cost below `give_up` is the sum over all pairs.
float msacCost(const PointArrays<float>& points, const Eigen::Matrix3d& homography, double limit,
               float give_up);

/// For each pair, sets inlier[i] to 1 if its reprojection error is below `limit`, else to 0.
/// Returns the number of ones.
std::size_t findInliers(const PointArrays<float>& points, const Eigen::Matrix3d& homography,
                        double limit, std::vector<std::uint8_t>& inlier);

/// Defines the problem that estimation::ProsacSearch solves: find a homography between normalised
/// coordinates. Reuses its buffers from call to call.
class HomographyProblem {
 public:
  using Model = Eigen::Matrix3d;
  static constexpr std::size_t kSample = std::tuple_size<FourPoints>::value;

  /// Keeps a pointer to the pairs, which must be sorted by quality, best first.
  void setPairs(const NormalisedPairs& pairs) { pairs_ = &pairs; }
  static std::size_t sampleSize() { return kSample; }
  std::size_t size() const { return pairs_->size(); }

  template <typename Visit>
  void solve(const estimation::ProsacSample& sample, Visit visit) const {
    Eigen::Matrix3d homography;
    if (solve(sample, homography)) visit(homography);
  }
  float cost(const Eigen::Matrix3d& homography, float give_up) const {
    return msacCost(pairs_->scoring, homography, pairs_->limit, give_up);
  }
  /// Refines H with the pairs whose error is below `widening` times the threshold. Returns false if
  /// there are no more than four such pairs, or if they do not determine H.
  bool refine(double widening, Eigen::Matrix3d& homography);
  std::size_t findInliers(const Eigen::Matrix3d& homography,
                          std::vector<std::uint8_t>& inlier) const {
    return ktgp_orb::homography::findInliers(pairs_->scoring, homography, pairs_->limit, inlier);
  }

 private:
  bool solve(const estimation::ProsacSample& sample, Eigen::Matrix3d& homography) const;

  const NormalisedPairs* pairs_ = nullptr;
  std::vector<std::uint8_t> near_;  // mask of the pairs that refine() used last
  ReprojectionFit estimator_;
};

/// Options for fitting a homography to point pairs.
struct EvidenceOptions {
  double max_error = 3.0;  ///< px, > 0; pairs with an error below twice this value take part
  /// Lower limit of the scale of the errors, px, > 0. With a limit well above the errors of the
  /// best points, the fit weights all points alike even if no plane explains them exactly. With a
  /// smaller limit, the fit would follow the points that happen to lie in one plane.
  double min_scale = 1e-4;
  /// True if the points come from aligned patches, which share noise if they overlap.
  bool of_patches = false;
  double rounding = 0.0;  ///< see PointPairs::rounding
  /// If true, pairs that are close together count like one pair. So a part of the scene with many
  /// pairs, which may lie slightly off the plane of the rest, does not determine H alone.
  bool by_cell = false;
};

/// Fits the most likely homography (see homography/reprojection_fit.h) to all pairs that it may
/// explain, and estimates its uncertainty. Reuses its buffers from call to call.
class HomographyFit {
 public:
  using Matrix8 = ReprojectionFit::Matrix8;

  /// Refines H (in normalised coordinates). Each round selects the pairs with an error below twice
  /// pairs.limit and fits H to them. Stops when the selection no longer changes, or after ten
  /// rounds. `corners`: corners of the reference image, px. Returns no_model if no more than four
  /// pairs are selected, and model_rejected if the selected pairs do not determine H.
  Status fit(const NormalisedPairs& pairs, const FourPoints& corners,
             const EvidenceOptions& options, Eigen::Matrix3d& homography);

  /// Returns true if the pairs of the last fit determine where H maps the image corners, even if we
  /// leave out every fourth pair, starting with the first, second, third or fourth (or any single
  /// pair, if there are at most eight). `homography`: the result of the fit.
  bool isDetermined(const NormalisedPairs& pairs, const FourPoints& corners,
                    const Eigen::Matrix3d& homography) const;

  /// Converts `homography`, the result of the last fit, to pixels, and computes its uncertainty.
  UncertainHomography inPixels(const NormalisedPairs& pairs, const FourPoints& corners,
                               const EvidenceOptions& options, const Eigen::Matrix3d& homography);

 private:
  ReprojectionFit estimator_;
  SmoothField field_;
  std::vector<std::uint8_t> near_;  // mask of the pairs whose error is below twice the threshold
  std::vector<std::uint8_t> used_;  // mask of the pairs of the last refinement
};

/// Options for keypoints. `by_cell`: see EvidenceOptions.
EvidenceOptions evidenceOfKeypoints(double max_error, bool by_cell);

/// Options for points from the alignment of patches. `max_error`: inlier threshold, px, for
/// keypoints in an image of 640x480 px. The threshold and the lower limit of the scale (a third of
/// the threshold) grow in proportion to the image's diagonal.
EvidenceOptions evidenceOfPatches(double max_error, const cv::Size& reference_size);

/// Estimates a homography again from more points or from more accurate points. It starts at the
/// given homography and draws no samples. Reuses its buffers from call to call.
class HomographyRefiner {
 public:
  /// Refines `estimate`. All values must be finite and in pixels. Returns true on success; then
  /// H(2,2) = 1. Returns false, with `estimate` unchanged, if too few pairs agree with `estimate`,
  /// if these pairs do not determine H, or if `estimate` is not the view of a plane from one side.
  /// `reference_size` may be empty (see imageCorners). Throws std::invalid_argument for arrays of
  /// different length.
  bool refine(const std::vector<Eigen::Vector2d>& reference,
              const std::vector<Eigen::Vector2d>& target, const cv::Size& reference_size,
              const EvidenceOptions& options, UncertainHomography& estimate);

 private:
  NormalisedPairs pairs_;
  HomographyFit fit_;
};

}  // namespace ktgp_orb::homography
