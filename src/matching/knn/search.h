#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "ktgp_orb/correspondence.h"
#include "matching/knn/index.h"
#include "matching/knn/kernel.h"
#include "util/thread_pool.h"

namespace ktgp_orb::knn {

/// Implements KnnMatcher::match() with a given kernel, so that tests and benchmarks can try each
/// kernel.
class KnnSearch {
 public:
  KnnSearch(const KnnKernel& kernel, int threads);

  /// See KnnMatcher::match or, if `mutual` is set, KnnMatcher::matchMutual.
  void match(const cv::Mat& reference, const cv::Mat& target, bool mutual,
             std::vector<Correspondence>& correspondences);

  util::ThreadPool& pool() { return pool_; }

 private:
  /// Finds the nearest neighbours of the queries of one chunk. If `nearest_queries` is not null,
  /// also searches in the other direction.
  void searchChunk(const cv::Mat& target, int chunk, Correspondence* correspondences,
                   NearestQueries* nearest_queries);

  KnnKernel kernel_;
  util::ThreadPool pool_;
  KnnIndex index_;                               // descriptors of the reference
  std::vector<NearestQueries> nearest_queries_;  // nearest query of each candidate, for each thread
};

}  // namespace ktgp_orb::knn
