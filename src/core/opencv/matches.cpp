#include "ktgp_orb/opencv.h"

namespace ktgp_orb {

std::vector<cv::DMatch> toDMatches(const std::vector<Correspondence>& correspondences,
                                   Level level) {
  std::vector<cv::DMatch> matches;
  for (const Correspondence& c : correspondences) {
    // At Level::knn there may be none that was near enough.
    if (c.level < level || c.reference_index < 0) continue;
    matches.emplace_back(c.reference_index, c.target_index, static_cast<float>(c.distance));
  }
  return matches;
}

}  // namespace ktgp_orb
