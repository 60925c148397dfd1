#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/features.h"
#include "ktgp_orb/knn_matcher.h"
#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::growth {

/// Finds mutual nearest neighbours of images that differ much in scale.
///
/// Among all keypoints, most true neighbours are missed: a fine scan has many keypoints on details
/// that the coarse scan does not resolve, and the coarse scan has large keypoints that the fine
/// scan has no octave for. So only keypoints are compared that have a size which the other image
/// has, too, after the change of scale. Keeps its buffers.
class AlikePairs {
 public:
  /// `scale`: px of the target for each px of the reference, or a rough value. `pairs`: receives
  /// the neighbours, px of the two images.
  void find(const Features& reference, const Features& target, double scale, PointPairs& pairs);

 private:
  /// The compared keypoints of one image.
  struct Part {
    std::vector<std::int32_t> indices;
    std::vector<std::uint8_t> descriptors;  // one after the other
  };
  /// Chooses the keypoints with a size from `least` to `most` px.
  static void choose(const Features& features, double least, double most, Part& part);

  std::array<Part, 2> parts_;  // of the reference and of the target
  KnnMatcher knn_;
  std::vector<Correspondence> matches_;
};

}  // namespace ktgp_orb::growth
