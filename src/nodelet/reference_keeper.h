#pragma once

#include <ros/time.h>

#include <optional>

#include "ktgp_orb/ktgp_matcher.h"
#include "nodelet/frame.h"

namespace ktgp_orb {

/// What a frame is matched to.
enum class ReferenceMode {
  previous,  ///< the frame before, as in the paper
  keyframe,  ///< one frame for as long as it overlaps and gives enough matches: less drift
  fixed,     ///< one frame set by hand: tracking of a planar target
};

struct ReferenceOptions {
  ReferenceMode mode = ReferenceMode::previous;
  double max_age = 1.0;      ///< s of header stamps; not for a fixed reference
  double min_overlap = 0.5;  ///< keyframe: share of the target image that the reference covers
  int min_inliers = 100;     ///< keyframe: final matches
};

/// Decides which frame the next one is matched to, and when to forget it.
class ReferenceKeeper {
 public:
  void setOptions(const ReferenceOptions& options);

  /// The frame to match `next` to, or null. Forgets a reference that cannot belong to the same
  /// sequence: the stamp went back (a looped bag), the frame before is older than max_age, or the
  /// size or encoding of the images has changed. A fixed reference stays.
  FramePtr referenceFor(const Frame& next);

  /// Keyframe mode, after `frame` was matched to the keyframe with `result`: the frame before, to
  /// match to as well, where the keyframe's support got weak; else null. Should that find a
  /// homography, it takes over, so that the chain of homographies does not break.
  FramePtr secondChoice(const Frame& frame, const MatchResult& result) const;

  /// After all matching of `frame`: `reference` and `result` are of the match that counts, null
  /// where there was no reference.
  void advance(const FramePtr& frame, const FramePtr& reference, const MatchResult* result);

  /// Homography from the first frame of the unbroken sequence to the last one advanced to, and the
  /// stamp of that first frame; nothing where the chain has just (re)started or in fixed mode.
  struct Accumulated {
    ros::Time first_stamp;
    Eigen::Matrix3d homography;
  };
  const std::optional<Accumulated>& accumulated() const { return accumulated_; }

  /// Makes `frame` the fixed reference; null: none.
  void setFixed(const FramePtr& frame) { fixed_ = frame; }
  const FramePtr& fixed() const { return fixed_; }
  /// Forgets every reference but the fixed one.
  void forget();

 private:
  bool weak(const Frame& frame, const MatchResult& result) const;
  void restartAt(const FramePtr& frame);

  ReferenceOptions options_;
  FramePtr fixed_;
  FramePtr reference_;  // previous: the frame before; keyframe: the keyframe
  FramePtr previous_;   // the frame before, with an unbroken chain of homographies to it
  // Homographies from the first frame of the sequence.
  ros::Time first_stamp_;
  Eigen::Matrix3d to_reference_ = Eigen::Matrix3d::Identity();
  Eigen::Matrix3d to_previous_ = Eigen::Matrix3d::Identity();
  std::optional<Accumulated> accumulated_;
};

/// Share of an image of `size` that the image warped by `homography` covers, 0..1.
double overlap(const Eigen::Matrix3d& homography, const cv::Size& size);

/// `later` - `earlier`, s. Unlike ros::Duration, which throws beyond 68 years, it takes the stamps
/// of any camera.
double secondsBetween(const ros::Time& earlier, const ros::Time& later);

}  // namespace ktgp_orb
