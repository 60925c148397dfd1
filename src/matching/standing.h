#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/features.h"
#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::matching {

/// The matches of two images of one size that stand still, as hot pixels, dirt on the lens and
/// burned-in text do, and those that move.
class Standing {
 public:
  /// Whether the homography leaves the whole image where it is.
  static bool standsStill(const Eigen::Matrix3d& homography, const Features& reference,
                          const Features& target);
  /// Divides the matches that passed GMS into those that stand still and those that move.
  void collect(const Features& reference, const Features& target,
               const std::vector<Correspondence>& matches);
  const PointPairs& moving() const { return moving_; }
  /// Whether the scene moves: enough moving matches have `mask`, and they lie all over the part of
  /// the image where the others stand still. A thing that moves in front of a camera that stands
  /// still covers less of the image.
  bool isScene(const std::vector<std::uint8_t>& mask);
  /// The level of matches that do not move becomes kt.
  static void drop(const Features& reference, const Features& target,
                   std::vector<Correspondence>& matches);
  /// Number of matches that passed the ratio filter and stand still where the homography says that
  /// the scene moves.
  static std::size_t count(const Eigen::Matrix3d& homography, const Features& reference,
                           const Features& target, const std::vector<Correspondence>& matches);

 private:
  PointPairs moving_;
  std::vector<Eigen::Vector2d> standing_;
  std::vector<Eigen::Vector2d> agreeing_;
};

}  // namespace ktgp_orb::matching
