#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/features.h"
#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::matching {

/// Separates the matches of two images of equal size into matches that stand still and matches that
/// move. Hot pixels, dirt on the lens and burned-in text stand still.
class Standing {
 public:
  /// Whether the homography leaves the whole image in place.
  static bool standsStill(const Eigen::Matrix3d& homography, const Features& reference,
                          const Features& target);
  /// Divides the matches that passed GMS into matches that stand still and matches that move.
  void collect(const Features& reference, const Features& target,
               const std::vector<Correspondence>& matches);
  const PointPairs& moving() const { return moving_; }
  /// Whether the scene moves: enough moving matches are marked in `mask`, and they spread over the
  /// part of the image where the other matches stand still. An object that moves in front of a
  /// still camera covers less of the image.
  bool isScene(const std::vector<std::uint8_t>& mask);
  /// Lowers the level of each match that does not move; the new level is Level::kt.
  static void drop(const Features& reference, const Features& target,
                   std::vector<Correspondence>& matches);
  /// Number of matches that passed the ratio filter and stand still at places where the homography
  /// moves the scene.
  static std::size_t count(const Eigen::Matrix3d& homography, const Features& reference,
                           const Features& target, const std::vector<Correspondence>& matches);

 private:
  PointPairs moving_;
  std::vector<Eigen::Vector2d> standing_;
  std::vector<Eigen::Vector2d> agreeing_;
};

}  // namespace ktgp_orb::matching
