#pragma once

#include <Eigen/Core>
#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/features.h"

namespace ktgp_orb {

/// Mean distance in bits between two unrelated descriptors.
constexpr int kUnrelatedDistance = 128;

/// Options of the nearest-neighbour search.
struct KnnOptions {
  int threads = 1;  ///< threads that share the queries, 0..1024; 0: all cores
  /// matchNear: largest distance of a keypoint from its predicted position, px of the reference,
  /// 0..10000. 0: KtgpMatcher searches the whole image, as in the paper.
  double search_radius = 0.0;
};

/// Exact search for the two reference descriptors nearest to each target descriptor (Eq. 1, 2).
/// Uses the best instructions of the processor, chosen at run time. The result does not depend on
/// them, nor on the number of threads. Memory: 66 bytes per reference descriptor, reused. A
/// reference with the same descriptors (and, for matchNear, positions) as in the last call is not
/// prepared again.
///
/// An instance belongs to one thread at a time; several instances may work in parallel.
class KnnMatcher {
 public:
  /// Starts the threads. Throws std::invalid_argument naming the option and its range.
  explicit KnnMatcher(const KnnOptions& options = {});
  ~KnnMatcher();
  KnnMatcher(KnnMatcher&&) noexcept;
  KnnMatcher& operator=(KnnMatcher&&) noexcept;

  const KnnOptions& options() const;

  /// `reference`, `target`: M×32 and N×32 CV_8U, continuous or not; otherwise
  /// std::invalid_argument. `correspondences` becomes N entries in target order, with Level::knn.
  /// For equal distances the lower reference index is nearest. With one reference descriptor there
  /// is no second neighbour: second_distance is 0, so no ratio passes. With none, `correspondences`
  /// is empty.
  void match(const cv::Mat& reference, const cv::Mat& target,
             std::vector<Correspondence>& correspondences);

  /// As match, and marks mutual nearest pairs (Correspondence::mutual). For equal distances from a
  /// reference descriptor, the lower target index is nearest. One pass over the distances finds
  /// both directions: about an eighth more time with AVX-512, less without. Memory: 10 bytes more
  /// per reference descriptor and thread.
  void matchMutual(const cv::Mat& reference, const cv::Mat& target,
                   std::vector<Correspondence>& correspondences);

  /// As match, but searches only the reference keypoints within `search_radius` of the predicted
  /// position. `prediction`: homography, reference to target, px. Time and memory grow with the
  /// number of keypoints within the radius.
  ///
  /// Exact: a reference keypoint at (x, y) is within the radius when (x - u)^2 + (y - v)^2 <=
  /// radius^2 in single precision; (u, v) is the target keypoint mapped by the inverse of
  /// `prediction` in double precision, then rounded. With only one keypoint, second_distance is the
  /// mean distance of unrelated descriptors (kUnrelatedDistance), but at least the first distance.
  /// With none, reference_index is -1 and both distances are 256. `mutual`: also marks mutual
  /// nearest pairs within the radius.
  ///
  /// Throws std::invalid_argument for malformed features, for more than 4 194 304 keypoints in a
  /// frame, for a prediction that cannot be inverted, and if search_radius is 0.
  void matchNear(const Features& reference, const Features& target,
                 const Eigen::Matrix3d& prediction, bool mutual,
                 std::vector<Correspondence>& correspondences);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ktgp_orb
