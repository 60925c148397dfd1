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
  int threads = 1;  ///< number of threads that share the work, 0..1024; 0 means all cores
  /// Radius for matchNear: largest distance of a reference keypoint from the predicted position of
  /// the target keypoint in the reference image, px, 0..10000. If it is 0, KtgpMatcher searches the
  /// whole image, as in the paper.
  double search_radius = 0.0;
};

/// Exact search for the two reference descriptors nearest to each target descriptor (Eq. 1, 2). At
/// run time, it chooses the best instruction set that the processor has. The result depends neither
/// on the instruction set nor on the number of threads. It needs 66 bytes of memory per reference
/// descriptor and reuses this memory in the next call.
///
/// An instance belongs to one thread at a time; several instances may work in parallel.
class KnnMatcher {
 public:
  /// Starts the threads. Throws std::invalid_argument, naming the option and its range, if an
  /// option is out of range.
  explicit KnnMatcher(const KnnOptions& options = {});
  ~KnnMatcher();
  KnnMatcher(KnnMatcher&&) noexcept;
  KnnMatcher& operator=(KnnMatcher&&) noexcept;

  const KnnOptions& options() const;

  /// `reference` and `target`: CV_8U matrices with M and N rows of 32 columns; they need not be
  /// continuous. Throws std::invalid_argument for other matrices. `correspondences` gets N entries
  /// in target order, with Level::knn. If distances are equal, the lower reference index counts as
  /// nearest. With a single reference descriptor there is no second neighbour; second_distance is
  /// then 0, so that no match passes the ratio test. Without reference descriptors,
  /// `correspondences` is empty.
  void match(const cv::Mat& reference, const cv::Mat& target,
             std::vector<Correspondence>& correspondences);

  /// Matches as match() does, and also marks mutual nearest pairs (Correspondence::mutual). If
  /// distances from a reference descriptor are equal, the lower target index counts as nearest. One
  /// pass over the distances finds the neighbours in both directions. It takes an eighth more time
  /// than match() with AVX-512, and less than an eighth without. It needs 10 bytes more per
  /// reference descriptor and thread.
  void matchMutual(const cv::Mat& reference, const cv::Mat& target,
                   std::vector<Correspondence>& correspondences);

  /// Matches as match() does, but searches only near the predicted position of each target keypoint
  /// in the reference: among the reference keypoints within KnnOptions::search_radius of this
  /// position. `prediction`: homography, reference to target, px. Time and memory grow with the
  /// number of keypoints within the radius.
  ///
  /// The radius is exact: a reference keypoint at (x, y) is within the radius if (x - u)^2 + (y -
  /// v)^2 <= radius^2 in single precision; (u, v) is the target keypoint mapped by the inverse of
  /// `prediction` in double precision, then rounded to single precision. If only one keypoint is
  /// within the radius, second_distance is the mean distance of unrelated descriptors
  /// (kUnrelatedDistance), but at least the first distance. If no keypoint is within the radius,
  /// reference_index is -1 and both distances are 256. If `mutual` is true, mutual nearest pairs
  /// within the radius are marked, too (see matchMutual).
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
