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

namespace ktgp_orb::evaluation {

/// The input of a method.
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

/// The state of a method. Every step removes matches from `matches` that do not pass it.
struct Matching {
  std::vector<Correspondence> matches;
  std::vector<Correspondence> candidates{};  ///< input of the estimation of the homography
  /// The method's own features, which `matches` refer to, if it does not use the scene's.
  std::optional<OwnFeatures> own{};
  ReferenceViews views{};                       ///< simulated views of the reference
  bool estimated = false;                       ///< a step has searched for a homography
  std::optional<UncertainHomography> answer{};  ///< if found; covariance NaN: not known
};

/// One stage of a method. May keep buffers; used by one thread.
struct Step {
  std::string name;
  std::function<void(const Scene&, Matching&)> run;
};

// Hamming space.
/// For every target descriptor the nearest of the reference (KNN with k = 2).
Step nearest(const KnnOptions& options);
/// The same, but only mutual nearest pairs; both directions in one pass.
Step mutualNearest(const KnnOptions& options);
/// TF: d1/d2 below `threshold`.
Step ratio(double threshold);
/// d1 at most twice the smallest d1 of the pair; d1 up to `floor` always passes.
Step distanceThreshold(int floor);
/// Cross-check: the target descriptor is also the nearest of its reference descriptor.
Step bidirectional(const KnnOptions& options);

// Descriptors as vectors in Euclidean space.
/// Cosine of the angle between the descriptors as vectors of 256 zeros and ones, at least
/// `threshold`.
Step cosineSimilarity(double threshold);
/// Norms of the descriptors as vectors of 32 bytes, which differ by at most `tolerance` times the
/// larger.
Step similarNorm(double tolerance);
/// Euclidean distance of the descriptors as vectors of 32 bytes, at most mean + standard deviation.
Step euclideanDistance();

// Images.
/// Mean grey value around the keypoints, in standard deviations from its image's mean; they differ
/// by at most `tolerance`.
Step greyLevel(double tolerance);

// Geometry.
Step gms(const GmsOptions& options);
Step gmsOver(const Neighbourhood& neighbourhood, const GmsOptions& options);
/// Keeps the inliers of the homography. `estimator`: see estimators().
Step homography(const std::string& estimator, const ProsacOptions& options);
/// Aligns matches by the images and corrects the homography. Keeps the matches used for it that
/// agree with the corrected homography; changes nothing if the alignment fails.
Step align(const MatcherOptions& options);

// Whole methods.
/// Options that keep the images, which the alignment needs; keeping them takes no time.
OrbOptions withImages(OrbOptions options);
/// The method's own features.
Step extract(const OrbOptions& options);
/// KtgpMatcher from end to end: its homography and final matches. With growth, uses the simulated
/// views of the reference from an earlier step.
Step matcher(const MatcherOptions& options);
/// Simulated views of the reference for the growth, extracted with the options `orb`.
Step simulate(const OrbOptions& orb, int views);

}  // namespace ktgp_orb::evaluation
