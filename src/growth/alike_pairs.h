#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/features.h"
#include "ktgp_orb/knn_matcher.h"
#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::growth {

/// Finds mutual nearest neighbours between two images that differ much in scale.
///
/// If all keypoints are compared, most true pairs are missed: the image with the higher resolution
/// has many keypoints on details that the other image does not show, and the other image has
/// keypoints so large that the first image has no pyramid level for them. So we compare only
/// keypoints whose size, converted to the scale of the other image, also occurs there. Reuses its
/// buffers from call to call.
class AlikePairs {
 public:
  /// `scale`: how many px of the target one px of the reference becomes; an estimate is enough.
  /// `pairs`: receives the positions of the neighbours, px.
  void find(const Features& reference, const Features& target, double scale, PointPairs& pairs);

 private:
  /// The keypoints of one image that are compared.
  struct Part {
    std::vector<std::int32_t> indices;      // indices into the features
    std::vector<std::uint8_t> descriptors;  // their descriptors, one after the other
  };
  /// Chooses the keypoints with a size from `least` to `most` px.
  static void choose(const Features& features, double least, double most, Part& part);

  std::array<Part, 2> parts_;  // compared keypoints of the reference [0] and of the target [1]
  KnnMatcher knn_;
  std::vector<Correspondence> matches_;
};

}  // namespace ktgp_orb::growth
