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

/// The state of a method. Every step removes the matches that do not pass it.
struct Matching {
  std::vector<Correspondence> matches;
  std::vector<Correspondence> candidates{};  ///< input of the estimation of the homography
  /// The method's own features, to which `matches` refer; empty if it uses the scene's features.
  std::optional<OwnFeatures> own{};
  ReferenceViews views{};                       ///< simulated views of the reference
  bool estimated = false;                       ///< a step has searched for a homography
  std::optional<UncertainHomography> answer{};  ///< if found; its covariance is NaN if not known
};

/// One stage of a method. It may keep buffers, and belongs to one thread.
struct Step {
  std::string name;
  std::function<void(const Scene&, Matching&)> run;
};

// Steps in Hamming space.
/// Finds the nearest reference descriptor of every target descriptor (KNN with k = 2).
Step nearest(const KnnOptions& options);
/// Finds only mutual nearest pairs, in both directions in one pass.
Step mutualNearest(const KnnOptions& options);
/// TF: keeps matches with d1/d2 below `threshold`.
Step ratio(double threshold);
/// Keeps matches with d1 of at most twice the smallest d1 of the image pair, or at most `floor`.
Step distanceThreshold(int floor);
/// Cross-check: the target descriptor must be the nearest of its reference descriptor, too.
Step bidirectional(const KnnOptions& options);

// Steps on descriptors as vectors in Euclidean space.
/// Keeps matches if the cosine of the angle between the descriptors, as vectors of 256 zeros and
/// ones, is at least `threshold`.
Step cosineSimilarity(double threshold);
/// Keeps matches if the norms of the descriptors, as vectors of 32 bytes, differ by at most
/// `tolerance` times the larger norm.
Step similarNorm(double tolerance);
/// Keeps matches if the Euclidean distance of the descriptors, as vectors of 32 bytes, is at most
/// mean + standard deviation.
Step euclideanDistance();

/// Keeps matches if the mean grey values around both keypoints, in standard deviations from the
/// mean of their image, differ by at most `tolerance`.
Step greyLevel(double tolerance);

Step gms(const GmsOptions& options);
Step gmsOver(const Neighbourhood& neighbourhood, const GmsOptions& options);
/// Keeps the inliers of the homography. `estimator`: see estimators().
Step homography(const std::string& estimator, const ProsacOptions& options);
/// Aligns matches by the images and corrects the homography. Keeps the aligned matches that agree
/// with the corrected homography. Changes nothing if the alignment fails.
Step align(const MatcherOptions& options);

/// Options that keep the images, which the alignment needs; keeping them takes no time.
OrbOptions withImages(OrbOptions options);
/// Extracts features of the method's own.
Step extract(const OrbOptions& options);
/// Runs KtgpMatcher from end to end and takes its homography and final matches. Growth uses the
/// simulated views of the reference from an earlier step.
Step matcher(const MatcherOptions& options);
/// Simulates views of the reference for the growth. `orb`: options for their features.
Step simulate(const OrbOptions& orb, int views);

}  // namespace ktgp_orb::evaluation
