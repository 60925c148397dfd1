#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <functional>
#include <optional>
#include <vector>

#include "ktgp_orb/features.h"
#include "ktgp_orb/ktgp_matcher.h"

namespace ktgp_orb::mosaic {

/// Frames with a known position in the map (keyframes). Other frames are placed in the map by
/// matching them to the keyframes.
class Keyframes {
 public:
  explicit Keyframes(const MatcherOptions& options) : matcher_(options) {}

  void setOptions(const MatcherOptions& options) { matcher_ = KtgpMatcher(options); }

  /// Finds the position of a frame, that is, the homography map -> frame, px. Matches the frame to
  /// the keyframe that covers most of it, and then to keyframes that cover less. `expected`: rough
  /// position of the frame. `chained`: true if `expected` follows from the previous frame; then the
  /// first match is enough. If false, `expected` is a guess, and the result has one position for
  /// each of the nearest keyframes that match. The result is empty if no keyframe matches.
  std::vector<Eigen::Matrix3d> locate(const Features& features, const Eigen::Matrix3d& expected,
                                      bool chained);

  /// Largest share of a frame that one keyframe covers, 0..1. `size`: size of the frame, px.
  double coverage(const cv::Size& size, const Eigen::Matrix3d& from_map) const;

  void add(Features features, const Eigen::Matrix3d& from_map);
  /// Moves the keyframes: the position P of each keyframe (homography map -> keyframe) becomes
  /// to(P).
  void move(const std::function<Eigen::Matrix3d(const Eigen::Matrix3d&)>& to);
  std::size_t size() const { return keyframes_.size(); }
  void clear();
  /// Deviation of the matched pairs from a plane, px; a running mean over the matches to keyframes.
  double planeDeviation() const { return plane_deviation_; }

 private:
  struct Keyframe {
    Features features;
    Eigen::Matrix3d from_map;  // homography map -> keyframe, px
  };
  double overlap(const Keyframe& keyframe, const cv::Size& size,
                 const Eigen::Matrix3d& from_map) const;

  KtgpMatcher matcher_;
  MatchResult result_;
  std::vector<Keyframe> keyframes_;
  double plane_deviation_ = 0.0;
};

}  // namespace ktgp_orb::mosaic
