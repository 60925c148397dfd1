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
  /// A pair is an inlier if its reprojection error in the target is below this value, px, > 0.
  double max_error = 3.0;
  int max_iterations = 2000;  ///< maximum number of samples, 1..1000000
  /// Probability that no better model was missed, in (0, 1). The paper's maximality rule has eta0 =
  /// 1 - confidence.
  double confidence = 0.995;
  std::uint64_t seed = 1;  ///< random seed of the sampling; the same seed gives the same answer
};

/// The input of the estimator: parallel arrays of equal length.
struct PointPairs {
  std::vector<Eigen::Vector2d> reference;  ///< positions in the reference image, px, finite
  std::vector<Eigen::Vector2d> target;     ///< positions in the target image, px, finite
  /// Quality beta = d1/d2 of each pair (Eq. 6); smaller is better.
  std::vector<double> quality;
  /// Standard deviation, per coordinate, of the error due to rounding the positions, px, >= 0;
  /// 1/sqrt(12) if they are rounded to whole pixels. It must be given because the residuals do not
  /// show it: neighbouring pairs with the same motion have the same rounding error.
  double rounding = 0.0;

  std::size_t size() const { return reference.size(); }
  void add(const Eigen::Vector2d& in_reference, const Eigen::Vector2d& in_target,
           double its_quality) {
    reference.push_back(in_reference);
    target.push_back(in_target);
    quality.push_back(its_quality);
  }
  void clear() {
    reference.clear();
    target.clear();
    quality.clear();
    rounding = 0.0;
  }
};

/// The rule that ended the sampling.
enum class ProsacStop : std::uint8_t {
  not_run,  ///< fewer than four pairs
  /// With the probability `confidence`, a better model would have been found by now.
  maximality,
  max_iterations,  ///< max_iterations samples were drawn
};

/// Covariance of the first eight entries of H, row by row. The type is not aligned, because Eigen's
/// alignment depends on the compiler's -march, and a program with another -march would read from
/// wrong addresses.
using Covariance8 = Eigen::Matrix<double, 8, 8, Eigen::DontAlign>;

/// A homography and its uncertainty: the answer of every stage that estimates a homography. All
/// fields are zero if there is no homography.
struct UncertainHomography {
  /// The matrix H that maps the reference to the target: x_target ~ H x_reference, in pixels. It is
  /// scaled so that H(2,2) = 1, unless H(2,2) is near zero.
  Eigen::Matrix3d homography = Eigen::Matrix3d::Zero();
  /// Covariance of H's first eight entries, row by row, with H(2,2) = 1; it is NaN if H(2,2) is
  /// near zero, which can happen if the origin is far from all points and no reference size is
  /// given. The covariance includes the noise of the points and the part of their errors that
  /// varies smoothly over the image (from a scene that is not quite a plane, lens distortion or a
  /// rolling shutter). It cannot include errors that are themselves a homography, such as the
  /// errors of a wrong calibration.
  Covariance8 covariance = Covariance8::Zero();
  /// The part of `covariance` that comes from the smooth errors. The smooth errors of the next
  /// frame's homography are similar, whereas the noise is independent in each frame.
  Covariance8 shared_covariance = Covariance8::Zero();
  /// Standard deviation per coordinate of the smooth errors, px in the target. It shows how far the
  /// scene is from a plane. It is 0 if the smooth errors cannot be distinguished from noise.
  double plane_deviation = 0.0;
};

/// The homography, the pairs that support it, and details of the search. If you reuse it for the
/// next call, it keeps its buffers.
struct ProsacResult {
  Status status = Status::no_model;  ///< ok, too_few_matches, no_model or model_rejected
  UncertainHomography answer;        ///< zero unless status is ok
  /// One entry per pair: 1 if its reprojection error is below the threshold, else 0.
  std::vector<std::uint8_t> mask;
  std::size_t inliers = 0;  ///< number of ones in `mask`
  double rmse = 0.0;        ///< root mean square reprojection error of the inliers, px
  /// Number of samples drawn, including samples from the inliers of the best model.
  int iterations = 0;
  ProsacStop stop = ProsacStop::not_run;
};
static_assert(alignof(ProsacResult) <= alignof(std::max_align_t),
              "the layout of results must not depend on the instruction set of the includer");

/// Distance, px, between `target` and the position that `homography` predicts for `reference`.
double reprojectionError(const Eigen::Matrix3d& homography, const Eigen::Vector2d& reference,
                         const Eigen::Vector2d& target);

/// Finds the homography that the largest number of pairs agrees with. Draws samples from the best
/// pairs first. The status says why no homography can be trusted:
/// - too_few_matches: fewer than four pairs;
/// - no_model: no homography agrees with more than the four pairs of its sample;
/// - model_rejected: chance explains the support of the best homography, or it mirrors the image,
///   or its inliers do not determine it. About one in 10 000 sets of random pairs passes the test
///   against chance, or one in 10^12 if the horizon crosses the reference image. In this test, an
///   inlier counts only if it is farther than the threshold from all inliers counted before, in
///   both images. The inliers do not determine the homography if it is uncertain by more than 10 px
///   at a corner, or by more than 20 px if a quarter of the inliers is left out.
/// The homography maximises the likelihood of the pairs within twice the threshold, whose errors
/// are assumed to have Student's t distribution. A pair is an inlier in the mask if its
/// reprojection error is below the threshold.
///
/// An instance belongs to one thread at a time; several instances may work in parallel.
class ProsacHomography {
 public:
  /// Throws std::invalid_argument, naming the option and its range, if an option is out of range.
  explicit ProsacHomography(const ProsacOptions& options = {});
  ~ProsacHomography();
  ProsacHomography(ProsacHomography&&) noexcept;
  ProsacHomography& operator=(ProsacHomography&&) noexcept;

  const ProsacOptions& options() const;

  /// `reference_size`: size of the reference image, px, used to check where the homography maps its
  /// corners and whether the horizon crosses it; if empty, the bounding box of the points is used.
  /// Throws std::invalid_argument for arrays of different length and for values that are not
  /// finite.
  void estimate(const PointPairs& pairs, const cv::Size& reference_size, ProsacResult& result);

  /// Estimates with an initial homography that may be right, for example predicted from earlier
  /// frames or found by another method. It is scored before the first sample; if the pairs support
  /// it, a few samples are enough. Apart from this, it has no advantage: it must win against the
  /// homographies of the samples, and is refined and tested like them. The homography is in px and
  /// may have any scale and sign. It is ignored if it cannot be the view of a plane from one side
  /// (singular or mirrored). Throws std::invalid_argument if it is not finite.
  void estimate(const PointPairs& pairs, const cv::Size& reference_size,
                const std::optional<Eigen::Matrix3d>& initial, ProsacResult& result);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ktgp_orb
