#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "core/knn/kernel.h"
#include "core/util/thread_pool.h"
#include "ktgp_orb/correspondence.h"

namespace ktgp_orb {

/// The search of KnnMatcher with a kernel of choice, so that tests and benchmarks can try each.
class KnnSearch {
 public:
  /// `threads`: see KnnOptions.
  KnnSearch(const KnnKernel& kernel, int threads);

  /// See KnnMatcher::match.
  void match(const cv::Mat& reference, const cv::Mat& target,
             std::vector<Correspondence>& correspondences);

 private:
  /// Keeps every row of the layout aligned to the widest vector.
  struct alignas(64) CacheLine {
    std::uint8_t bytes[64];
  };

  void layOut(const cv::Mat& reference);
  void searchChunk(const cv::Mat& target, int first, int end, Correspondence* correspondences);

  KnnKernel kernel_;
  ThreadPool pool_;
  int group_count_ = 0;
  std::vector<CacheLine> groups_;  // the reference as described in knn_kernel.h
};

}  // namespace ktgp_orb
