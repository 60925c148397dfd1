#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include "ktgp_orb/features.h"
#include "ktgp_orb/orb_extractor.h"
#include "ktgp_orb/target_finder.h"

namespace ktgp_orb::targets {

/// A frame, resized for the search. If small targets are wanted, the frame is enlarged to twice its
/// size, because a target below kSmallSide has too few keypoints. A frame whose longer side is
/// below 480 px is enlarged up to four times, because targets are smaller there. The longer side of
/// an enlarged frame is at most kLargestFrame. So a frame longer than half of this limit is
/// enlarged by a factor of less than two. A frame longer than four fifths of it is not enlarged,
/// because a factor below 1.25 hardly helps. A frame longer than kLargestFrame is shrunk, because
/// the pyramid has no level that is small enough to find a target that fills it. Reuses its
/// buffers.
class SearchedFrame {
 public:
  explicit SearchedFrame(const TargetFinderOptions& options);

  /// `image` must live until the next call. `wants_small`: targets below kSmallSide are wanted.
  void set(const cv::Mat& image, bool wants_small);
  /// Uses features that the caller has extracted from the frame at its original size.
  void set(const Features& features);

  const Features& features() const { return *features_; }
  /// Size of the searched frame divided by the size of the original frame.
  double scale() const { return scale_; }
  /// The map from the searched frame to the original frame, px.
  const Eigen::Matrix3d& toFrame() const { return to_frame_; }
  /// The frame at its original size, as a pyramid with one level; empty if features were given.
  const std::vector<cv::Mat>& own() const { return own_; }

  /// A target is small if its shorter side in the original frame is below this limit, px.
  static constexpr double kSmallSide = 80.0;
  static constexpr int kLargestFrame = 2500;  ///< limit of a searched frame's longer side, px

 private:
  void setEnlargement(double by);

  OrbExtractor extractor_;
  OrbExtractor enlarged_extractor_;
  double enlargement_ = 0.0;  // enlargement for which enlarged_extractor_ was made
  cv::Mat resized_;
  std::vector<cv::Mat> own_;
  Features extracted_;
  const Features* features_ = &extracted_;
  double scale_ = 1.0;
  Eigen::Matrix3d to_frame_ = Eigen::Matrix3d::Identity();
};

}  // namespace ktgp_orb::targets
