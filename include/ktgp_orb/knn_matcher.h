#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "ktgp_orb/correspondence.h"

namespace ktgp_orb {

/// Options of the nearest-neighbour search.
struct KnnOptions {
  int threads = 1;  ///< threads that share the queries; 0 = all of the machine; the answer is equal
};

/// Exact search for the two reference descriptors nearest to each target descriptor (Eq. 1, 2).
class KnnMatcher {
 public:
  /// Throws std::invalid_argument for a negative number of threads.
  explicit KnnMatcher(const KnnOptions& options = {});

  /// `reference`, `target`: M×32 and N×32 CV_8U, continuous or not; else std::invalid_argument.
  /// `correspondences` becomes N entries in target order, with level knn. Equal distances: the
  /// lower reference index is nearest. With one reference descriptor there is no second neighbour
  /// and second_distance is 0, so that no ratio passes; with none, `correspondences` is empty.
  void match(const cv::Mat& reference, const cv::Mat& target,
             std::vector<Correspondence>& correspondences);

 private:
  KnnOptions options_;
};

}  // namespace ktgp_orb
