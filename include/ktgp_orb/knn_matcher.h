#pragma once

#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "ktgp_orb/correspondence.h"

namespace ktgp_orb {

/// Options of the nearest-neighbour search.
struct KnnOptions {
  int threads = 1;  ///< threads that share the queries, 0..1024; 0 = all cores
};

/// Exact search for the two reference descriptors nearest to each target descriptor (Eq. 1, 2).
/// The best instructions of the processor are chosen at run time. The answer does not depend on
/// them, nor on the number of threads. Memory: 34 bytes per reference descriptor, reused.
///
/// An instance belongs to one thread at a time; several instances may run side by side.
class KnnMatcher {
 public:
  /// Starts the threads. Throws std::invalid_argument for a number of them outside 0..1024.
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

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ktgp_orb
