#include "ktgp_orb/knn_matcher.h"

#include <cstring>
#include <limits>

#include "ktgp_orb/features.h"
#include "options_check.h"

namespace ktgp_orb {
namespace {

int hamming(const std::uint8_t* a, const std::uint8_t* b) {
  int distance = 0;
  for (int i = 0; i < kDescriptorBytes; i += 8) {
    std::uint64_t x = 0;
    std::uint64_t y = 0;
    std::memcpy(&x, a + i, 8);
    std::memcpy(&y, b + i, 8);
    distance += __builtin_popcountll(x ^ y);
  }
  return distance;
}

}  // namespace

KnnMatcher::KnnMatcher(const KnnOptions& options) : options_(options) {
  requireInRange("threads", options.threads, 0, 1024);
}

void KnnMatcher::match(const cv::Mat& reference, const cv::Mat& target,
                       std::vector<Correspondence>& correspondences) {
  requireDescriptors(reference, "reference");
  requireDescriptors(target, "target");
  correspondences.clear();
  if (reference.empty()) return;
  for (int t = 0; t < target.rows; ++t) {
    Correspondence c;
    c.target_index = t;
    c.distance = c.second_distance = std::numeric_limits<int>::max();
    for (int r = 0; r < reference.rows; ++r) {
      const int distance = hamming(reference.ptr(r), target.ptr(t));
      if (distance < c.distance) {
        c.second_distance = c.distance;
        c.distance = distance;
        c.reference_index = r;
      } else if (distance < c.second_distance) {
        c.second_distance = distance;
      }
    }
    if (reference.rows < 2) c.second_distance = 0;
    correspondences.push_back(c);
  }
}

}  // namespace ktgp_orb
