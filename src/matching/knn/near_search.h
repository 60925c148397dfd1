#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <opencv2/core/types.hpp>
#include <string>
#include <vector>

#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/features.h"
#include "matching/knn/index.h"
#include "matching/knn/kernel.h"
#include "util/cell_grid.h"
#include "util/thread_pool.h"

namespace ktgp_orb::knn {

/// Throws std::invalid_argument, with `name` in the message, if there are more keypoints than the
/// keys of kernel.h can number.
void requireCountable(const Features& features, const std::string& name);

constexpr std::int32_t kNearIndexMask = kMaxNearFeatures - 1;

/// The candidates of the search near predicted positions, in the layout of the kernels. They are
/// sorted by position, so that the candidates of a query form only a few runs. Reuses its buffers
/// from call to call.
class NearTable {
 public:
  /// `place(i)`: position of keypoint i, px; a keypoint whose position is not finite is never near.
  /// `image`, `side`: see CellGrid::build; `side` should be between half the search radius and the
  /// radius.
  template <typename Place>
  void build(const Features& features, const Place& place, const cv::Size& image, double side) {
    cells_.build(features.size(), place, image, side);
    layOut(features);
    for (std::size_t i = 0; i < size(); ++i) {
      const cv::Point2f p = place(static_cast<std::size_t>(index_[i]));
      x_[i] = p.x;
      y_[i] = p.y;
    }
  }
  std::size_t size() const { return position_.size(); }

  /// Returns the best two candidates within `radius` px of `place`. `number`: number of the query.
  /// `nearest_queries` is null, or has columns() keys, which are initially kNoNearKey (see
  /// KnnKernel).
  NearKeys search(const KnnKernel& kernel, const std::uint8_t* descriptor, const cv::Point2f& place,
                  double radius, std::int32_t number, std::int32_t* nearest_queries) const;

  std::size_t columns() const { return stride_; }
  /// The column of keypoint `index`.
  std::size_t column(std::int32_t index) const {
    return static_cast<std::size_t>(position_[static_cast<std::size_t>(index)]);
  }

 private:
  void layOut(const Features& features);

  util::CellGrid cells_;
  std::size_t stride_ = 0;  // size() plus the number of entries that kernels may read past the end
  std::vector<std::uint32_t> words_;
  std::vector<float> x_;
  std::vector<float> y_;
  std::vector<std::int32_t> index_;     // index of the keypoint in each column
  std::vector<std::int32_t> position_;  // the column of each keypoint
};

/// Implements KnnMatcher::matchNear() with a given kernel, so that tests and benchmarks can try
/// each kernel. Both reference and target are sorted into cells. So the candidates of a query form
/// few runs, and are still in the cache from the previous query.
class NearSearch {
 public:
  /// `radius`: px, > 0. `pool` must outlive this object.
  NearSearch(const KnnKernel& kernel, double radius, util::ThreadPool& pool);

  void match(const Features& reference, const Features& target, const Eigen::Matrix3d& prediction,
             bool mutual, std::vector<Correspondence>& correspondences);

 private:
  void placeQueries(const Features& target, const Eigen::Matrix3d& prediction);
  void searchChunk(const Features& target, int chunk, std::int32_t* nearest_queries,
                   Correspondence* correspondences) const;
  void markMutual(std::vector<Correspondence>& correspondences);

  KnnKernel kernel_;
  double radius_;
  util::ThreadPool& pool_;
  // The keypoints of the reference, sorted by predicted position.
  NearTable table_;
  // The keypoints of the target, sorted by position.
  util::CellGrid query_cells_;
  std::vector<cv::Point2f> places_;  // predicted positions of the keypoints of the target
  std::vector<std::vector<std::int32_t>>
      nearest_queries_;  // for each thread, the key of the nearest query of each candidate
};

}  // namespace ktgp_orb::knn
