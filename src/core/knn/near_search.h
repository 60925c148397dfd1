#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <opencv2/core/types.hpp>
#include <vector>

#include "core/knn/index.h"
#include "core/knn/near_kernel.h"
#include "core/knn/near_table.h"
#include "core/util/cell_grid.h"
#include "core/util/thread_pool.h"
#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/features.h"

namespace ktgp_orb::knn {

/// The search of KnnMatcher::matchNear with a given kernel, so that tests and benchmarks can try
/// each. Reference and target are sorted into cells. So the candidates of a query form few runs,
/// and are still in the cache from the previous query.
class NearSearch {
 public:
  /// `radius`: px, > 0. `pool` must outlive this.
  NearSearch(const NearKernel& kernel, double radius, util::ThreadPool& pool);

  /// See KnnMatcher::matchNear.
  void match(const Features& reference, const Features& target, const Eigen::Matrix3d& prediction,
             bool mutual, std::vector<Correspondence>& correspondences);

 private:
  /// Lays the reference out, unless it is that of the last call.
  void setReference(const Features& reference);
  bool holds(const Features& reference) const;
  void placeQueries(const Features& target, const Eigen::Matrix3d& prediction);
  void searchChunk(const Features& target, int chunk, std::int32_t* nearest_queries,
                   Correspondence* correspondences) const;
  Correspondence search(const std::uint8_t* descriptor, std::int32_t number,
                        std::int32_t* nearest_queries) const;
  void markMutual(std::vector<Correspondence>& correspondences);

  NearKernel kernel_;
  double radius_;
  util::ThreadPool& pool_;
  // The reference.
  NearTable table_;
  cv::Size image_size_;
  DescriptorCopy laid_out_;
  // The target.
  util::CellGrid query_cells_;
  std::vector<cv::Point2f> places_;  // predicted positions of the keypoints
  std::vector<std::vector<std::int32_t>>
      nearest_queries_;  // of each candidate, one for each thread
};

}  // namespace ktgp_orb::knn
