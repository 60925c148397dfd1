#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "evaluation/dataset.h"
#include "evaluation/methods.h"
#include "ktgp_orb/metrics.h"
#include "ktgp_orb/orb_extractor.h"

namespace ktgp_orb::evaluation {

constexpr std::array<double, 3> kPrecisionThresholds{1.0, 2.0, 3.0};
constexpr std::array<double, 4> kAucThresholds{1.0, 3.0, 5.0, 10.0};
/// A homography with a larger corner error is wrong, px.
constexpr double kWrongBeyond = 20.0;

/// The error e at the image corners, and its covariance S by the covariance of the homography.
struct CornerConsistency {
  double predicted = 0.0;              ///< root mean trace of S over the corners, px
  double ratio = 0.0;                  ///< root mean square of e over `predicted`
  std::array<double, 4> normalised{};  ///< e' S^-1 e at each corner; median 1.39 if S is right
};
/// 99.9 % of e' S^-1 e are below this if S is right: chi-square with two degrees of freedom.
constexpr double kConsistentBelow = 13.8;

/// The result of one method for one pair.
struct MethodScore {
  std::string method;
  std::string problem{};       ///< why the method could not work on the pair; empty if it could
  std::size_t matches = 0;     ///< NM
  double retention = 0.0;      ///< matches over target keypoints; the paper's Q for the method KT
  double matched_share = 0.0;  ///< REP by Eq. 9 of the paper
  metrics::ErrorSummary descriptor_distance;
  metrics::ErrorSummary displacement;        ///< px
  metrics::ErrorSummary reprojection_error;  ///< px, against the truth
  std::array<double, kPrecisionThresholds.size()> precision{};
  std::size_t correct = 0;  ///< matches within metrics::kCorrectWithin
  /// Mean error over the corners, or over the annotated points, px. Infinite if the method found no
  /// homography; empty if it estimates none.
  std::optional<double> corner_error;
  bool found = false;  ///< the method accepts a homography
  /// Whether the errors of the homography at annotated points are within the 99.9 % bound of its
  /// covariance. Empty without annotated points or without a covariance.
  std::optional<bool> within_covariance;
  /// Comparison of the homography's error at the four corners with its covariance; empty without a
  /// covariance, or if the truth is annotated points.
  std::optional<CornerConsistency> consistency;
  /// Correlation of the images in the part that the homography overlaps; see overlapCorrelation.
  std::optional<double> zncc;
  std::vector<StepResult> steps;
  double milliseconds = 0.0;        ///< all steps, without the features of the scene
  double total_milliseconds = 0.0;  ///< from the images to the result
};

/// One pair with every method.
struct PairScore {
  ImagePair pair;
  std::string problem;  ///< why the pair could not be used; empty if it could
  std::size_t reference_keypoints = 0;
  std::size_t target_keypoints = 0;
  double extraction_milliseconds = 0.0;  ///< features of both images
  double detector_repeatability = 0.0;
  std::vector<MethodScore> methods;
};

/// The size at which images are evaluated, px; 0: their own size. Only one member is set.
struct EvaluatedSize {
  int longest_side = 0;   ///< larger images are reduced to this size
  int shortest_side = 0;  ///< all images get this size
};

/// Evaluates pairs one after the other, reusing its buffers; used by one thread.
class PairEvaluator {
 public:
  /// Each method is run `repetitions` times; the result has the median of each step's time.
  /// `truth_deviation`: standard deviation of the true homographies at the corners, px. It is added
  /// to the covariances that are compared with the truth.
  PairEvaluator(const OrbOptions& orb, std::vector<Method> methods, int repetitions,
                const EvaluatedSize& size = {}, double truth_deviation = 0.0);

  /// A file that cannot be read, and a method that fails, give a problem, not an exception.
  PairScore evaluate(const ImagePair& pair);

 private:
  void evaluateImages(const cv::Mat& reference, const cv::Mat& target, PairScore& score);
  double extract(const cv::Mat& reference, const cv::Mat& target);
  MethodScore evaluateMethod(const Method& method, const Scene& scene, const Eigen::Matrix3d& truth,
                             const std::vector<AnnotatedPoint>& points,
                             double extraction_milliseconds);

  OrbExtractor extractor_;
  std::vector<Method> methods_;
  int repetitions_;
  EvaluatedSize size_;
  double truth_deviation_;
  Features reference_;
  Features target_;
};

}  // namespace ktgp_orb::evaluation
