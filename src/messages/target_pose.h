#pragma once

#include <optional>

#include "core/homography/estimate.h"
#include "ktgp_orb/planar_pose.h"
#include "ktgp_orb/prosac_homography.h"
#include "messages/camera.h"
#include "messages/message_conversion.h"

namespace ktgp_orb {

/// Where a flat target is, from what was found in a frame and the camera that its pixels belong to.
/// An instance belongs to one thread at a time.
class TargetPose {
 public:
  /// `options`: of the homography where the lens distorts.
  void setOptions(const ProsacOptions& options);

  /// `width`: of what the reference image shows, m. Nothing without correspondences and where no
  /// target before the camera gives them.
  ///
  /// Through a lens that distorts no homography leads to a flat target: there the aligned points,
  /// or the matches that passed GMS, are moved to where they are without distortion, and the
  /// homography is theirs.
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
