#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/features.h"
#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb::matching {

/// Warning for users if MatchResult::hasStillThings() is true.
constexpr const char* kThingsStandStill =
    "things stand still in the image while the scene moves: hot pixels, dirt on the lens, text or "
    "a part of the vehicle";

/// Separates the matches of two images of equal size into matches that stand still and matches that
/// move. Hot pixels, dirt on the lens and burned-in text stand still, for example.
class Standing {
 public:
  /// Divides the matches that passed GMS into matches that stand still and matches that move.
  /// Returns true if there are more than a few of both.
  bool collect(const Features& reference, const Features& target,
               const std::vector<Correspondence>& matches);
  const PointPairs& moving() const { return moving_; }
  /// Returns true if the matches that stand still may determine or bend `answer`, the homography of
  /// all matches: it leaves the whole image in place, or most of them agree with it, so that it may
  /// be a mixture of both motions. `max_error`: largest error of an inlier, px.
  bool mayMislead(const Eigen::Matrix3d& answer, double max_error);
  /// Returns true if the scene itself moves, not just one object in front of a still camera. Call
  /// mayMislead() first. `moving`: homography of the moving matches; its mask marks the moving
  /// matches that agree with it. At least 20 must agree, spread over the same part of the image as
  /// the still matches; a single object covers less. If the answer moves the image, most still
  /// matches must also contradict `moving`; still matches near the axis of a turn would not. If the
  /// answer leaves the image in place and most still matches contradict `moving`, twice as many
  /// moving as still matches are enough, however they are spread.
  bool isScene(const ProsacResult& moving);
  /// Lowers the level of each match that does not move where the homography moves the scene to
  /// Level::kt, as if it had not passed GMS.
  static void lower(const Eigen::Matrix3d& homography, const Features& reference,
                    const Features& target, std::vector<Correspondence>& matches);
  /// Erases the matches that do not move where the homography clearly moves the scene, if more of
  /// them stand still than chance can explain.
  static void erase(const Eigen::Matrix3d& homography, const Features& reference,
                    const Features& target, std::vector<Correspondence>& matches);
  /// Number of matches that passed the ratio filter and stand still at places where the homography
  /// moves the scene.
  static std::size_t count(const Eigen::Matrix3d& homography, const Features& reference,
                           const Features& target, const std::vector<Correspondence>& matches);

 private:
  std::size_t countMoved(const Eigen::Matrix3d& homography, double least) const;

  cv::Size image_size_;
  bool answer_stands_still_ = false;
  PointPairs moving_;
  std::vector<Eigen::Vector2d> standing_;
  std::vector<Eigen::Vector2d> agreeing_;
};

}  // namespace ktgp_orb::matching
