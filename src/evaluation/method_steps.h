#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "evaluation/estimators.h"
#include "evaluation/grid_statistics.h"
#include "ktgp_orb/alignment.h"
#include "ktgp_orb/gms_filter.h"
#include "ktgp_orb/knn_matcher.h"
#include "ktgp_orb/ktgp_matcher.h"
#include "ktgp_orb/orb_extractor.h"

namespace ktgp_orb::tools {

/// The pair of images that a method matches.
struct Scene {
  const cv::Mat& reference_image;  ///< 8-bit grey
  const cv::Mat& target_image;     ///< 8-bit grey
  const Features& reference;
  const Features& target;
};

/// Keypoints of both images; descriptors of any kind, or none.
struct OwnFeatures {
  Features reference;
  Features target;
};

/// What a method has found so far. Every step takes from `matches` what does not pass it.
struct Matching {
  std::vector<Correspondence> matches;
  std::vector<Correspondence> candidates{};  ///< what the homography was estimated from
  /// Where a method does not use the scene's features: its own, which `matches` refer to.
  std::optional<OwnFeatures> own{};
  ReferenceViews views{};                       ///< of the reference, from other sides
  bool estimated = false;                       ///< a step has looked for a homography
  std::optional<Eigen::Matrix3d> homography{};  ///< reference to target, where it found one
  std::optional<Covariance8> covariance{};      ///< of it, where the estimator gives one
};

/// One stage of a method. May keep buffers: a step serves one thread.
struct Step {
  std::string name;
  std::function<void(const Scene&, Matching&)> run;
};

// Hamming space.
/// For every target descriptor the nearest of the reference (KNN with k = 2).
Step nearest(const KnnOptions& options);
/// The same, but only pairs of which each is the other's nearest; both directions in one pass.
Step mutualNearest(const KnnOptions& options);
/// TF: d1/d2 below `threshold`, strictly.
Step ratio(double threshold);
/// d1 of at most twice the smallest d1 of the pair, and of at most `floor` in any case.
Step distanceThreshold(int floor);
/// Cross-check: the target descriptor is also the nearest of its reference descriptor.
Step bidirectional(const KnnOptions& options);

// Descriptors as vectors in Euclidean space.
/// Cosine of the angle between the descriptors as 256 zeros and ones of at least `threshold`.
Step cosineSimilarity(double threshold);
/// Norms of the descriptors as 32 bytes differ by at most `tolerance` times the larger.
Step similarNorm(double tolerance);
/// Euclidean distance of the descriptors as 32 bytes of at most mean + standard deviation.
Step euclideanDistance();

// Images.
/// Mean grey value around the keypoints, each in standard deviations from its image's mean, differs
/// by at most `tolerance`.
Step greyLevel(double tolerance);

// Geometry.
Step gms(const GmsOptions& options);
Step gmsOver(const Neighbourhood& neighbourhood, const GmsOptions& options);
/// Keeps the inliers of the homography.
Step homography(Estimator estimator, const ProsacOptions& options);
/// Aligns matches by the images, corrects the homography by them, and keeps of those that it was
/// estimated from the matches that agree with the corrected one; all stays where it cannot.
Step align(const AlignmentOptions& options);

// All at once.
/// Features of the method's own.
Step extract(const OrbOptions& options);
/// KtgpMatcher from end to end: its homography and final matches. Where its growth is on, with the
/// simulated views of the reference that a step before has made.
Step matcher(const MatcherOptions& options);
/// Views of the reference as the growth has use for, found with the options `orb`.
Step simulate(const OrbOptions& orb, int views);

}  // namespace ktgp_orb::tools
