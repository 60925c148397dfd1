#pragma once

#include <optional>

#include "core/homography/estimate.h"
#include "ktgp_orb/planar_pose.h"
#include "ktgp_orb/prosac_homography.h"
#include "messages/camera.h"
#include "messages/message_conversion.h"

namespace ktgp_orb {

/// Pose of a flat target, from the result of a frame and the camera of its pixels.
/// An instance belongs to one thread at a time.
class TargetPose {
 public:
  /// `options`: for the homography in case of distortion.
  void setOptions(const ProsacOptions& options);

  /// `width`: the width that the reference image shows, m. Empty without correspondences, and if
  /// they do not give a target in front of the camera.
  ///
  /// With lens distortion, no homography maps a flat target to the image. Then the aligned points,
  /// or the matches that passed GMS, are rectified, and a homography is fitted to them.
  std::optional<PlanarPose> find(const FrameMessages& messages, const PixelCamera& camera,
                                 double width);

 private:
  void undistort(const FrameMessages& messages, const Lens& lens);
  UncertainHomography homographyOfPairs(const cv::Size& reference);

  ProsacHomography prosac_;
  homography::HomographyRefiner refiner_;
  homography::Finaliser finaliser_;
  PointPairs pairs_;
  bool of_patches_ = false;  // pairs_ are aligned points
  ProsacResult result_;
  homography::FinalHomography final_;
};

}  // namespace ktgp_orb
