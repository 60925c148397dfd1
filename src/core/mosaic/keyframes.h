#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "ktgp_orb/features.h"
#include "ktgp_orb/ktgp_matcher.h"

namespace ktgp_orb::mosaic {

/// The frames whose place in the map others are found by.
class Keyframes {
 public:
  explicit Keyframes(const MatcherOptions& options) : matcher_(options) {}

  void setOptions(const MatcherOptions& options) { matcher_ = KtgpMatcher(options); }

  /// Where a frame is, by a match to the keyframe that covers most of it; where that fails, to the
  /// next ones. `expected`: map -> frame, roughly; `chained`: the path from the frame before says
  /// so, else it is a guess, and more of them are tried. Nothing: none fits.
  std::optional<Eigen::Matrix3d> locate(const Features& features, const Eigen::Matrix3d& expected,
                                        bool chained);

  /// Share of the frame that the best keyframe covers, 0..1.
  double coverage(const cv::Size& size, const Eigen::Matrix3d& from_map) const;

  void add(Features features, const Eigen::Matrix3d& from_map);
  std::size_t size() const { return keyframes_.size(); }
  void clear() { keyframes_.clear(); }

 private:
  struct Keyframe {
    Features features;
    Eigen::Matrix3d from_map;  // map -> keyframe, px
  };
  double overlap(const Keyframe& keyframe, const cv::Size& size,
                 const Eigen::Matrix3d& from_map) const;

  KtgpMatcher matcher_;
  MatchResult result_;
  std::vector<Keyframe> keyframes_;
};

}  // namespace ktgp_orb::mosaic
