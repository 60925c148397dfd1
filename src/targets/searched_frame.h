#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include "ktgp_orb/features.h"
#include "ktgp_orb/orb_extractor.h"
#include "ktgp_orb/target_finder.h"

namespace ktgp_orb::targets {

/// A frame at the size at which it is searched. A target below kSmallSide has too few keypoints. So
/// if such targets are wanted, the frame is enlarged to twice its size. A frame below 480 px is
/// enlarged up to four times, because targets are smaller there. The enlarged frame has at most
/// kLargestFrame px: above half of this the enlargement is less than twofold, and above four fifths
/// there is none. A frame above kLargestFrame is made smaller, because the pyramid does not reach a
/// target that fills it. Reuses its buffers.
class SearchedFrame {
 public:
  explicit SearchedFrame(const TargetFinderOptions& options);

  /// `image` must live until the next call. `wants_small`: targets below kSmallSide are wanted.
  void set(const cv::Mat& image, bool wants_small);
  /// Uses the given features, unchanged.
  void set(const Features& features);

  const Features& features() const { return *features_; }
  /// px of the searched frame per px of the frame.
  double scale() const { return scale_; }
  /// Searched frame -> frame, px.
  const Eigen::Matrix3d& toFrame() const { return to_frame_; }
  /// The frame at its own size, as a pyramid of one level; empty if features were given.
  const std::vector<cv::Mat>& own() const { return own_; }

  static constexpr double kSmallSide = 80.0;  ///< shorter side of a target, px of the frame
  static constexpr int kLargestFrame = 2500;  ///< px, longer side

 private:
  void setEnlargement(double by);

  OrbExtractor extractor_;
  OrbExtractor enlarged_extractor_;
  double enlargement_ = 0.0;  // factor of enlarged_extractor_
  cv::Mat resized_;
  std::vector<cv::Mat> own_;
  Features extracted_;
  const Features* features_ = &extracted_;
  double scale_ = 1.0;
  Eigen::Matrix3d to_frame_ = Eigen::Matrix3d::Identity();
};

}  // namespace ktgp_orb::targets
