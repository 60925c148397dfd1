#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <opencv2/core/types.hpp>
#include <optional>
#include <vector>

#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/features.h"
#include "ktgp_orb/lens.h"
#include "ktgp_orb/planar_pose.h"
#include "ktgp_orb/prosac_homography.h"
#include "ktgp_orb/status.h"

namespace ktgp_orb {

/// The geometry that explains the matches of two images.
enum class Geometry : std::uint8_t {
  none = 0,
  plane = 1,     ///< a homography: the scene is flat (or K is not known and the camera only turned)
  rotation = 2,  ///< the camera only turned, or stood still; found only if K is known
  epipolar = 3,  ///< a scene with depth: essential matrix if K is known, else fundamental matrix
};

/// Returns the enumerator's name, e.g. "epipolar".
const char* toString(Geometry geometry);

/// Why another explanation of the pairs cannot be excluded, or why all explanations were rejected.
enum class Doubt : std::uint8_t {
  none = 0,
  /// Two motions explain a plane equally well, and no pair tells them apart.
  two_motions_of_a_plane = 1,
  /// Too few pairs are off the dominant plane, or these pairs are all in one place.
  few_points_off_the_plane = 2,
  small_parallax = 3,  ///< another direction or the opposite sign of the translation fits as well
  /// The texture repeats, and wrong pairs, shifted by a period, fit as well. There is no geometry
  /// if hardly any precise pair agrees.
  repetitive = 4,
  /// A part of the scene may move: a camera that only turned or stood still explains all pairs
  /// outside one compact region, or the pairs off the dominant plane have another motion.
  moving_region = 5,
  /// The inliers map the image to its mirror image, which no camera can do.
  mirrored = 6,
  other_motion = 7,  ///< another motion fits equally well, for a reason that is not listed above
  /// The inliers do not determine the epipolar geometry. The result is then a plane or a rotation
  /// or, without a homography or without TwoViewOptions::homography, Geometry::none.
  undetermined = 8,
};

/// Returns the enumerator's name, e.g. "small_parallax".
const char* toString(Doubt doubt);

/// Standard deviations of the errors that all points of an image share. The residuals do not show
/// them, so the covariance of every geometry includes them. All are >= 0.
struct SharedErrors {
  /// Errors that vary linearly over the image, px at the mean distance of the points from their
  /// centre, 0..1000, because calibration, lens model and shutter are not exact.
  double linear = 0.0;
  double focal = 0.0;  ///< relative error of the focal length, the same in both images, 0..1
  double zoom = 0.0;   ///< relative change of the focal length between the images, 0..1
  /// Error of the principal point along x and along y, as a share of the focal length, 0..1, the
  /// same in both images.
  double principal_point = 0.0;
  /// Remaining radial distortion, px at the corners, 0..1000; grows with the third power of the
  /// radius and is the same in both images.
  double distortion = 0.0;
  /// Readout time of a rolling shutter, as a share of the time between the images, 0..1; 0: global
  /// shutter.
  double readout = 0.0;

  /// Returns 0.05 px, 1 %, 0.3 %, 0.3 %, 0.3 px and 1/3, typical of real cameras (sources:
  /// shared_errors.cpp).
  static SharedErrors ofRealCameras();
  bool operator==(const SharedErrors& other) const;
};

/// Options of the two-view geometry.
struct TwoViewOptions {
  /// Largest reprojection error of an inlier of a homography in the target, px, > 0. For an
  /// epipolar geometry, the largest Sampson distance of an inlier is half of this value, since the
  /// Sampson distance splits an error between both images.
  double max_error = 3.0;
  int max_iterations = 1000;  ///< maximum number of samples, 1..1000000; for the plane at most 250
  double confidence = 0.995;  ///< probability that no better model was missed, in (0, 1)
  std::uint64_t seed = 1;     ///< random seed of the sampling; the same seed gives the same answer
  /// If false, only an epipolar geometry is an answer. The dominant plane is searched for all the
  /// same: where it explains the pairs, they do not determine an epipolar geometry.
  bool homography = true;
  SharedErrors shared_errors;  ///< none by default; see SharedErrors::ofRealCameras
  /// Only for TwoViewMatcher: if true, refines the points by aligning image patches, provided that
  /// the features have images.
  bool alignment = true;
};

/// How the camera moved from the reference to the target. A point with the coordinates x_reference
/// in the reference camera's frame (x right, y down, z forward) has x_target = R x_reference + t in
/// the target camera's frame, with the rotation R and the translation t. The unit of length is the
/// distance between the two camera positions.
struct RelativePose {
  Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
  /// Unit vector, or zero if the camera only turned.
  Eigen::Vector3d translation = Eigen::Vector3d::Zero();
};

/// Prior knowledge about the two images.
struct TwoViewInput {
  /// Camera matrices K of the images without lens distortion, px. Leave the reference's K empty if
  /// it is not known; then no motion is estimated.
  std::optional<Eigen::Matrix3d> reference_camera;
  std::optional<Eigen::Matrix3d> target_camera;  ///< if empty, the reference's K is used
  cv::Size reference_size;  ///< px; if empty, the bounding box of the points is used
  cv::Size target_size;     ///< px; if empty, the bounding box of the points is used
  /// A guess at the motion, for example the motion of the previous frame. It is scored before the
  /// first sample, and the fit also starts from it. Not used without K or if its translation is 0.
  std::optional<RelativePose> prediction;
  /// For TwoViewMatcher: lens that maps points of the images to images without distortion, to which
  /// K belongs; null if the images have no distortion. With a lens, pairs, fundamental matrix and
  /// homography refer to images without distortion.
  const Lens* reference_lens = nullptr;
  const Lens* target_lens = nullptr;
  /// Standard deviation of the error of each pair, 1e-6..1e6, relative to the error of the most
  /// precise pairs, which have 1; null if all pairs are equally precise. TwoViewMatcher sets it.
  const std::vector<double>* deviations = nullptr;
  /// A guess at the homography, for example from the matches before alignment.
  std::optional<Eigen::Matrix3d> homography;
};

/// A point of the scene in the reference camera's frame.
struct ScenePoint {
  /// Index of the point pair that this point was triangulated from.
  std::size_t pair = 0;
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  ///< unit: distance between the cameras
  /// Covariance of `position` if the motion were exact; see triangulate() for the errors of pairs.
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
};

/// A motion that explains the pairs about as well as the likeliest motion.
struct OtherMotion {
  Geometry geometry = Geometry::none;
  RelativePose pose;
  /// Covariance of this motion; see TwoView::pose_covariance.
  Covariance6 pose_covariance = Covariance6::Zero();
  double probability = 0.0;  ///< probability of this motion, in [0, 1]
};

/// Result of TwoViewEstimator::estimate. If you reuse it for the next call, it keeps its buffers.
struct TwoView {
  Status status = Status::no_model;  ///< ok, too_few_matches, no_model or model_rejected
  /// If the status is ok: why the motion `other` cannot be excluded or, for `undetermined`, why the
  /// geometry is not epipolar. If the status is model_rejected: why there is no answer. Else none.
  Doubt doubt = Doubt::none;
  Geometry geometry = Geometry::none;

  /// If the geometry is a plane or a rotation: its homography. If it is epipolar: the homography of
  /// the dominant plane, if there is one and TwoViewOptions::homography is true. Otherwise zero.
  Eigen::Matrix3d homography = Eigen::Matrix3d::Zero();
  /// The fundamental matrix F for positions in px: x_target^T F x_reference = 0. Its norm is 1. It
  /// is zero for a rotation, and for a plane if K is not known.
  Eigen::Matrix3d fundamental = Eigen::Matrix3d::Zero();

  /// If K is known: the likeliest motion, and its probability in [0, 1]. `other` is the likeliest
  /// motion that differs clearly from `pose`; empty if it can be excluded. If `other` is set, the
  /// two probabilities add up to 1.
  RelativePose pose;
  double probability = 0.0;
  std::optional<OtherMotion> other;
  /// Covariance of small changes of the translation (x, y, z) and of small rotations about the
  /// target camera's axes (rad), in this order. Its rank is 5, because the length of the
  /// translation is fixed. For a pure rotation the rank is 6: the covariance then allows for
  /// translations that are too small to be noticed, in units of the distance to the scene. If
  /// `other` is set, the covariance is large enough to cover both motions. NaN if K is missing or
  /// the covariance is unknown.
  Covariance6 pose_covariance = Covariance6::Zero();
  /// Median over all inliers of the angle between the two rays of a pair, degrees; NaN without K.
  double parallax = 0.0;

  /// One entry per pair: 1 if it agrees with the geometry and, if K is known, its scene point lies
  /// in front of both cameras; else 0.
  std::vector<std::uint8_t> mask;
  std::size_t inliers = 0;  ///< number of ones in `mask`
  /// Root mean square over the inliers, px: reprojection error in the target (plane, rotation) or
  /// Sampson distance (epipolar).
  double rmse = 0.0;
  /// Robust scale of the Sampson distances, px; 0 unless epipolar. With TwoViewInput::deviations,
  /// the scale of a pair whose deviation is 1.
  double scale = 0.0;

  /// log10 of the number of false alarms: the expected number of models that get the same support
  /// by chance (Moisan & Stival, IJCV 2004; Moulon, Monasse & Marlet, ACCV 2012); 0 if there is no
  /// model. The epipolar geometry is chosen if its number is smaller, and below 1e-20.
  double log_false_alarms_homography = 0.0;
  double log_false_alarms_epipolar = 0.0;
  int iterations = 0;  ///< number of samples drawn in the search for the epipolar geometry
};
static_assert(alignof(TwoView) <= alignof(std::max_align_t),
              "the layout of results must not depend on the instruction set of the includer");

/// Finds the geometry that explains the point pairs of two images; see Geometry.
///
/// PROSAC searches for each model, with samples of four pairs for a homography, five for an
/// essential matrix (Nister, PAMI 2004) and seven for a fundamental matrix. Then a maximum
/// likelihood fit refines the motion; it assumes that the Sampson distances have Student's t
/// distribution.
///
/// The model with fewer false alarms is chosen. A pair may agree with a wrong model by chance. The
/// probability of this is the share of the image that lies within the error of the pair: in a disc
/// around the predicted point for a homography, or in a strip on both sides of the epipolar line.
/// If there is a homography, the epipolar geometry is chosen only if the pairs also show parallax:
/// their residuals under the homography must point along the epipolar lines more often than random
/// directions would. Therefore a scene with a plane and a few points off it is reported as an
/// epipolar geometry, and a scene without such points as a plane.
///
/// The status is model_rejected if chance cannot explain a geometry, but other evidence contradicts
/// it or the inliers do not determine it; see TwoView::doubt.
///
/// An instance belongs to one thread at a time; several instances may work in parallel.
class TwoViewEstimator {
 public:
  /// Throws std::invalid_argument, naming the option and its range, if an option is out of range.
  explicit TwoViewEstimator(const TwoViewOptions& options = {});
  ~TwoViewEstimator();
  TwoViewEstimator(TwoViewEstimator&&) noexcept;
  TwoViewEstimator& operator=(TwoViewEstimator&&) noexcept;

  const TwoViewOptions& options() const;

  /// Throws std::invalid_argument for arrays of different length, values that are not finite, and
  /// an impossible K: focal lengths that no camera has, fx / fy outside 1/4..4, entries that are
  /// not finite, a K of the target alone, one K for two image sizes, or a principal point outside
  /// the image, which happens if K belongs to another image size.
  void estimate(const PointPairs& pairs, const TwoViewInput& input, TwoView& result);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Estimates the two-view geometry in one call, without a TwoViewEstimator. The pairs must be
/// sorted, best first.
TwoView estimateTwoView(const std::vector<Eigen::Vector2d>& reference,
                        const std::vector<Eigen::Vector2d>& target, const TwoViewInput& input = {},
                        const TwoViewOptions& options = {});

/// Result of TwoViewMatcher::estimate: the two-view geometry of the matches of two frames. If you
/// reuse it for the next call, it keeps its buffers.
struct TwoViewMatches {
  TwoView view;
  /// Point pairs of the matches of level ktg and above, in the order of the matches. If a match
  /// could be aligned, its points are the aligned positions, which are more accurate than the
  /// keypoints.
  PointPairs pairs;
  std::vector<std::size_t> match;  ///< index of each pair in the list of matches
  /// For each pair, 1 if its points were aligned by image patches, else 0.
  std::vector<std::uint8_t> aligned;
  /// Level of each match: Level::ktgp if it agrees with the geometry of `view`, otherwise its old
  /// level, but at most Level::ktg.
  std::vector<Level> levels;
};

/// Estimates the two-view geometry of matches, after aligning each match to a fraction of a pixel.
///
/// Keypoints are accurate to half a pixel. For each match, the patch of 16x16 px around the
/// reference keypoint is found in the target (see Alignment). The patch is warped by the affine map
/// that fits the twelve nearest matches, so the scene need not be a plane. A match keeps the
/// positions of its keypoints if alignment would move it by more than 4 px, or if its patches do
/// not look alike (correlation below 0.8). Without Features::images, all matches keep the positions
/// of their keypoints.
///
/// An instance belongs to one thread at a time; several instances may work in parallel.
class TwoViewMatcher {
 public:
  /// Throws std::invalid_argument, naming the option and its range, if an option is out of range.
  explicit TwoViewMatcher(const TwoViewOptions& options = {});
  ~TwoViewMatcher();
  TwoViewMatcher(TwoViewMatcher&&) noexcept;
  TwoViewMatcher& operator=(TwoViewMatcher&&) noexcept;

  /// `matches`: the correspondences of KtgpMatcher. The image sizes are taken from the features,
  /// not from `input`. Throws in the same cases as TwoViewEstimator::estimate.
  void estimate(const Features& reference, const Features& target,
                const std::vector<Correspondence>& matches, const TwoViewInput& input,
                TwoViewMatches& result);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Computes the scene points of the inliers, in the order of the pairs. `points` is empty if there
/// is no pose with a translation. Pairs whose rays are parallel within the errors are left out. The
/// errors of all pairs have the scale TwoView::scale, or rmse if `scale` is 0. Throws
/// std::invalid_argument if the mask of `geometry` has another length than `pairs`.
void triangulate(const PointPairs& pairs, const TwoViewInput& input, const TwoView& geometry,
                 std::vector<ScenePoint>& points);

/// Computes the scene points of `matches`. Measures the error of the aligned pairs and the error of
/// the other pairs separately. Prefer this function: TwoView::scale is the error of aligned pairs,
/// and other pairs are less accurate.
void triangulate(const TwoViewMatches& matches, const TwoViewInput& input,
                 std::vector<ScenePoint>& points);

}  // namespace ktgp_orb
