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
/// move. Hot pixels, dirt on the lens and burned-in text stand still, for example.
class Standing {
 public:
  /// Returns true if the homography leaves the whole image in place.
  static bool standsStill(const Eigen::Matrix3d& homography, const Features& reference,
                          const Features& target);
  /// Divides the matches that passed GMS into matches that stand still and matches that move.
  void collect(const Features& reference, const Features& target,
               const std::vector<Correspondence>& matches);
  const PointPairs& moving() const { return moving_; }
  /// Returns true if the scene itself moves, not just one object in front of a still camera.
  /// `mask`: marks the moving matches that agree on a homography. There must be enough of them, and
  /// they must be spread over the same part of the image as the matches that stand still; a single
  /// object covers less.
  bool isScene(const std::vector<std::uint8_t>& mask);
  /// Lowers the level of each match that does not move to Level::kt, as if it had not passed GMS.
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
