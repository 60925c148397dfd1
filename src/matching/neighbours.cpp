#include "matching/neighbours.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "growth/local_frame.h"
#include "util/constants.h"

namespace ktgp_orb::matching {
namespace {

/// Measured on the mutual matches of Reichstag, of which 25 % agree with the true motion: 54 % of
/// the matches with a vote do so, and 70 % of the matches with two; of the right matches, 95 and 94
/// % remain.
constexpr std::int32_t kFewestVotes = 2;

/// Returns the largest distance between a match and the matches that confirm it, px. In a large
/// image, matches are farther apart; then it is the radius of a disc with twelve matches.
float reachFor(std::size_t matches, const cv::Size& image) {
  constexpr double kNeighbours = 12.0;
  const double each = static_cast<double>(image.width) * image.height /
                      static_cast<double>(std::max<std::size_t>(matches, 1));
  return std::max(growth::Votes::kReach,
                  static_cast<float>(std::sqrt(each * kNeighbours / util::kPi)));
}

}  // namespace

std::size_t Neighbours::drop(const Features& reference, const Features& target,
                             std::vector<Correspondence>& matches) {
  votes_.clear();
  std::size_t count = 0;
  for (const Correspondence& c : matches) {
    if (c.level < Level::ktg) continue;
    votes_.add(growth::frameOf(reference.keypoints[static_cast<std::size_t>(c.reference_index)]),
               growth::frameOf(target.keypoints[static_cast<std::size_t>(c.target_index)]));
    ++count;
  }
  votes_.count(reference.image_size, target.image_size, kFewestVotes,
               reachFor(count, reference.image_size));
  std::size_t dropped = 0;
  std::size_t i = 0;
  for (Correspondence& c : matches) {
    if (c.level < Level::ktg || votes_.votes()[i++] >= kFewestVotes) continue;
    c.level = Level::kt;
    ++dropped;
  }
  return dropped;
}

}  // namespace ktgp_orb::matching
