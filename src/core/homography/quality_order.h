#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace ktgp_orb::homography {

/// The order in which PROSAC draws: best quality first. Keeps its buffers.
class QualityOrder {
 public:
  /// Smaller is better. Equal qualities stay in the order of the input.
  void sort(const std::vector<double>& quality);

  /// The index in the input of the pair at `place` in the order.
  std::size_t operator[](std::size_t place) const { return keys_[place] & kIndexMask; }
  std::size_t size() const { return keys_.size(); }

 private:
  static constexpr int kIndexBits = 32;
  static constexpr std::uint64_t kIndexMask = 0xffffffffU;

  std::vector<std::uint64_t> keys_;  // quality in the upper half, index in the lower
  std::vector<std::uint64_t> sorted_;
};

}  // namespace ktgp_orb::homography
