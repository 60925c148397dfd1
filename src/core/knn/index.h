#pragma once

#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "core/knn/nearest_queries.h"

namespace ktgp_orb::knn {

/// A copy of the descriptors of an index, to detect whether they changed. Comparing takes a
/// hundredth of the time of building the index.
class DescriptorCopy {
 public:
  void assign(const cv::Mat& descriptors);
  void clear() { bytes_.clear(); }
  bool equals(const cv::Mat& descriptors) const;

 private:
  std::vector<std::uint8_t> bytes_;
};

/// A reference in the layout of kernel.h for the search of the whole image. It is rebuilt only when
/// its content changes, which the index detects itself.
class KnnIndex {
 public:
  /// `lanes` of the kernel.
  explicit KnnIndex(int lanes) : lanes_(lanes) {}

  void setReference(const cv::Mat& reference);

  int candidates() const { return candidates_; }
  int groupCount() const { return group_count_; }
  std::ptrdiff_t groupBytes() const;
  const std::uint8_t* group(int i) const { return groups_.front().bytes + i * groupBytes(); }

 private:
  void layOut(const cv::Mat& reference);

  int lanes_;
  int candidates_ = 0;  // reference descriptors
  int group_count_ = 0;
  std::vector<CacheLine> groups_;
  DescriptorCopy laid_out_;
};

}  // namespace ktgp_orb::knn
