#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/homography/points.h"
#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb {

/// The point pairs as the search works on them: best quality first, and normalised.
struct ProsacPoints {
  Normalisation reference, target;
  PointArrays<float> scoring;       // single precision is enough to count inliers ...
  PointArrays<double> refinement;   // ... but not to refine
  double limit = 0.0;               // the inlier threshold in normalised target units
  double min_reference_area = 0.0;  // square of the threshold, in normalised units of each image:
  double min_target_area = 0.0;     // triangles below that are too flat to sample

  std::size_t size() const { return scoring.size; }

  /// `threshold` in px. Equal qualities stay in the order of the input.
  void load(const PointPairs& pairs, double threshold);

 private:
  void sortByQuality(const std::vector<double>& quality);

  std::vector<std::uint64_t> order_;  // quality in the upper half, index in the lower
  std::vector<std::uint64_t> sorted_;
};

}  // namespace ktgp_orb
