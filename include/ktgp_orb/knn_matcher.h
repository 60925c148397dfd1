#pragma once

#include <Eigen/Core>
#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/features.h"

namespace ktgp_orb {

/// Bits in which two descriptors that have nothing to do with each other differ on average.
constexpr int kUnrelatedDistance = 128;

/// Options of the nearest-neighbour search.
struct KnnOptions {
  int threads = 1;  ///< threads that share the queries, 0..1024; 0 = all cores
  /// matchNear: how far from its predicted place a keypoint is looked for, px of the reference,
  /// 0..10000. 0: KtgpMatcher searches the whole image, the paper's KNN.
  double search_radius = 0.0;
};

/// Exact search for the two reference descriptors nearest to each target descriptor (Eq. 1, 2).
/// The best instructions of the processor are chosen at run time. The answer does not depend on
/// them, nor on the number of threads. Memory: 66 bytes per reference descriptor, reused. A
/// reference with the descriptors (and, for matchNear, places) of the last call is not laid out
/// again.
///
/// An instance belongs to one thread at a time; several instances may run side by side.
class KnnMatcher {
 public:
  /// Starts the threads. Throws std::invalid_argument naming the option and its range.
  explicit KnnMatcher(const KnnOptions& options = {});
  ~KnnMatcher();
  KnnMatcher(KnnMatcher&&) noexcept;
  KnnMatcher& operator=(KnnMatcher&&) noexcept;

  const KnnOptions& options() const;

  /// `reference`, `target`: M×32 and N×32 CV_8U, continuous or not; else std::invalid_argument.
  /// `correspondences` becomes N entries in target order, with level knn. Equal distances: the
  /// lower reference index is nearest. With one reference descriptor there is no second neighbour
  /// and second_distance is 0, so that no ratio passes; with none, `correspondences` is empty.
  void match(const cv::Mat& reference, const cv::Mat& target,
             std::vector<Correspondence>& correspondences);

  /// As match, and marks the pairs of which each is the other's nearest (Correspondence::mutual).
  /// Among target descriptors at equal distance from a reference descriptor the lower index is
  /// the nearest. One pass over the distances finds both directions: about an eighth more time with
  /// AVX-512, less without. Memory: 10 bytes more per reference descriptor and thread.
  void matchMutual(const cv::Mat& reference, const cv::Mat& target,
                   std::vector<Correspondence>& correspondences);

  /// The same search where the match can be: among the reference keypoints within `search_radius`
  /// of where the target keypoint is predicted to come from. `prediction`: homography, reference to
  /// target, px. Time and memory grow with the keypoints within the radius, not with all of them.
  ///
  /// Exact: a reference keypoint at (x, y) is within when (x - u)^2 + (y - v)^2 <= radius^2 in
  /// single precision, (u, v) being the target keypoint sent through the inverse of `prediction` in
  /// double precision and rounded. Where there is only one, the second is as far as unrelated
  /// descriptors are on average (kUnrelatedDistance), or as far as the first where that is farther;
  /// where there is none, reference_index is -1 and both distances are 256. `mutual`: also marks
  /// the pairs of which each is the other's nearest, within the radius.
  ///
  /// Throws std::invalid_argument for malformed features, for more than 4 194 304 keypoints in a
  /// frame, for a prediction that cannot be inverted and where search_radius is 0.
  void matchNear(const Features& reference, const Features& target,
                 const Eigen::Matrix3d& prediction, bool mutual,
                 std::vector<Correspondence>& correspondences);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ktgp_orb
