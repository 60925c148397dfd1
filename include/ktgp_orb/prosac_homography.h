#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <opencv2/core/types.hpp>
#include <optional>
#include <vector>

#include "ktgp_orb/status.h"

namespace ktgp_orb {

/// Options of the homography estimator (Chum & Matas, "Matching with PROSAC", CVPR 2005).
struct ProsacOptions {
  double max_error = 3.0;  ///< inlier when the reprojection error in the target is below, px, > 0
  int max_iterations = 2000;  ///< samples drawn at most, 1..1000000
  /// 1 - eta0 of the maximality rule: wanted probability that no better model was missed, in (0,
  /// 1).
  double confidence = 0.995;
  std::uint64_t seed = 1;  ///< of the estimator's own generator; same seed, same answer
};

/// The correspondences as the estimator sees them: three parallel arrays of equal length.
struct PointPairs {
  std::vector<Eigen::Vector2d> reference;  ///< px in the reference image, finite
  std::vector<Eigen::Vector2d> target;     ///< px in the target image, finite
  std::vector<double> quality;             ///< beta = d1/d2 (Eq. 6), smaller is better

  std::size_t size() const { return reference.size(); }
  void clear() {
    reference.clear();
    target.clear();
    quality.clear();
  }
};

/// The rule that ended the sampling.
enum class ProsacStop : std::uint8_t {
  not_run,         ///< fewer than four pairs
  maximality,      ///< a better model would have been found with the wanted confidence
  max_iterations,  ///< the budget was used up
};

/// Of eight entries, row by row. Eigen would align it as the widest vector register of whoever
/// includes this, and a program built with another -march would read the results elsewhere.
using Covariance8 = Eigen::Matrix<double, 8, 8, Eigen::DontAlign>;

/// A homography and how uncertain it is. The identity without uncertainty at first.
struct UncertainHomography {
  /// x_target ~ H x_reference in pixels, H(2,2) = 1 unless near zero.
  Eigen::Matrix3d homography = Eigen::Matrix3d::Identity();
  /// Covariance of H's first eight entries, row by row, with H(2,2) = 1; NaN where H(2,2) is near
  /// zero, which takes an origin far from all points and no reference size. It covers the noise of
  /// the points and the part of their errors that varies smoothly over the image (the scene is not
  /// quite a plane, the lens bends, the shutter rolls). It cannot cover errors that are themselves
  /// a homography, such as those of a wrong calibration.
  Covariance8 covariance = Covariance8::Zero();
  /// The part of `covariance` that comes from the smooth errors. The next frame's homography has
  /// much the same error, while noise is another one in each frame.
  Covariance8 shared_covariance = Covariance8::Zero();
  /// Standard deviation per coordinate of the smooth errors, px in the target: how far the scene is
  /// from a plane. 0 where it cannot be told from noise.
  double plane_deviation = 0.0;
};

/// How the search went, for tests and for tuning.
struct ProsacDiagnostics {
  int iterations = 0;               ///< samples drawn, those from a best model's inliers as well
  int local_optimisations = 0;      ///< times a new best model was polished
  std::size_t growth_set_size = 0;  ///< best pairs sampled from at the end, n of PROSAC
  ProsacStop stop = ProsacStop::not_run;
};

/// Homography, its support and how it was found. Reused from call to call for its buffers.
struct ProsacResult {
  Status status = Status::no_model;  ///< ok, too_few_matches, no_model or model_rejected
  /// x_target ~ H x_reference in pixels, H(2,2) = 1 unless near zero; zero unless status is ok.
  Eigen::Matrix3d homography = Eigen::Matrix3d::Zero();
  /// 1 where the reprojection error of `homography` is below the threshold, exactly; else 0.
  std::vector<std::uint8_t> mask;
  std::size_t inliers = 0;  ///< ones in `mask`
  double rmse = 0.0;        ///< root mean square reprojection error of the inliers, px
  Covariance8 covariance = Covariance8::Zero();         ///< see UncertainHomography
  Covariance8 shared_covariance = Covariance8::Zero();  ///< the same
  double plane_deviation = 0.0;                         ///< px, the same
  ProsacDiagnostics diagnostics;
};
static_assert(alignof(ProsacResult) <= alignof(std::max_align_t),
              "the layout of results must not depend on the instruction set of the includer");

/// Distance in px between H x_reference and x_target: what the mask is about.
double reprojectionError(const Eigen::Matrix3d& homography, const Eigen::Vector2d& reference,
                         const Eigen::Vector2d& target);

/// Finds the homography that most pairs agree with, sampling the best pairs first, or says why it
/// does not trust any:
/// - too_few_matches: fewer than four pairs;
/// - no_model: nothing but the four pairs of a sample agrees with any homography;
/// - model_rejected: the best one has a support that chance explains (fewer than about one in
///   10 000 sets of random pairs pass; a pair closer than the threshold to another in one of the
///   images adds nothing), turns the image inside out, sends a part of it beyond the horizon, or is
///   not determined by its inliers: uncertain by more than 10 px at a corner, or by more than 20 px
///   once a quarter of the inliers is left out.
/// The homography maximises the likelihood under Student's t errors over the pairs within twice the
/// threshold; its mask is the plain test against the threshold.
///
/// An instance belongs to one thread at a time; several instances may run side by side.
class ProsacHomography {
 public:
  /// Throws std::invalid_argument naming the option and its range.
  explicit ProsacHomography(const ProsacOptions& options = {});
  ~ProsacHomography();
  ProsacHomography(ProsacHomography&&) noexcept;
  ProsacHomography& operator=(ProsacHomography&&) noexcept;

  const ProsacOptions& options() const;

  /// `reference_size`: of the reference image in px, for the check that H's horizon does not cross
  /// it; empty: the bounding box of the points instead. Throws std::invalid_argument for arrays of
  /// different length or a value that is not finite.
  void estimate(const PointPairs& pairs, const cv::Size& reference_size, ProsacResult& result);

  /// The same, starting at a homography that may be right, as predicted from the frames before or
  /// found by another method: it is scored before the first sample, and where the pairs support it
  /// a few samples are enough. It is not trusted: it must win against the samples, is refined, and
  /// the verdict is the same. In px, of any scale and sign; ignored where it cannot be the view of
  /// a plane from one side (singular or mirrored). Throws std::invalid_argument where it is not
  /// finite.
  void estimate(const PointPairs& pairs, const cv::Size& reference_size,
                const std::optional<Eigen::Matrix3d>& initial, ProsacResult& result);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ktgp_orb
