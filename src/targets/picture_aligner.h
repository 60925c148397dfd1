#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

#include "features/alignment/patch_aligner.h"
#include "homography/fit.h"
#include "ktgp_orb/prosac_homography.h"
#include "targets/target_picture.h"

namespace ktgp_orb::targets {

/// Corrects the homography of a picture by aligning patches of the images, as ktgp_orb::Alignment
/// does for two frames. It differs from Alignment in two ways. The picture is first made as small
/// as it appears in the frame, by averaging, so that both images are equally sharp. The patches lie
/// on a grid over the whole picture, not at keypoints, because a small target has few keypoints.
/// Reuses its buffers.
class PictureAligner {
 public:
  PictureAligner();

  /// Finds the homography of the whole picture from `map`, an affine map picture -> frame that is
  /// right only near `centre` (px of the picture). Aligns the patches near `centre`, fits the map
  /// to them, and repeats this with a larger and larger radius. Returns true and stores the
  /// homography in `estimate`, or returns false if too few patches agree.
  bool grow(const TargetPicture& picture, const std::vector<cv::Mat>& frame,
            const Eigen::Vector2d& centre, const Eigen::Matrix3d& map,
            UncertainHomography& estimate);

  /// `frame`: pyramid of the frame, not empty. `estimate`: picture -> frame, px; its error is at
  /// most about 4 px. Returns true if it has corrected `estimate`; `pairs` are then the pairs of
  /// points to which it was fitted. Returns false, with both unchanged, if too few patches were
  /// found in the frame or if they do not agree on a homography.
  bool align(const TargetPicture& picture, const std::vector<cv::Mat>& frame,
             UncertainHomography& estimate, PointPairs& pairs);

 private:
  void setPicture(const TargetPicture& picture, const Eigen::Matrix3d& homography);
  bool alignNear(const Eigen::Vector2d& centre, double reach, double step,
                 const Eigen::Matrix3d& map);
  double nearOf(const Eigen::Matrix3d& homography);
  bool isInside(const Eigen::Matrix3d& map, const Eigen::Vector2d& point) const;
  bool refine(UncertainHomography& estimate);
  Eigen::Vector2d sumBands(const Eigen::Matrix3d& homography);
  void addVibration(UncertainHomography& estimate);

  /// Sums over the patches in a band of rows of the frame, which are exposed at about the same
  /// time.
  struct Band {
    double count = 0.0;
    Eigen::Vector2d error = Eigen::Vector2d::Zero();  // sum of the errors, px
    // Sum of the derivatives of the patches' positions with respect to the homography's entries.
    Eigen::Matrix<double, 2, 8> slope = Eigen::Matrix<double, 2, 8>::Zero();
    Eigen::Matrix<double, 8, 8> information = Eigen::Matrix<double, 8, 8>::Zero();
  };

  alignment::PatchAligner aligner_;
  homography::HomographyRefiner refiner_;
  cv::Mat shrunk_;              // the picture at the size that it has in the frame
  std::vector<cv::Mat> small_;  // pyramid with one level: shrunk_ with a border
  cv::Size size_;               // size of shrunk_
  std::vector<Eigen::Vector2d> reference_, target_;
  std::vector<double> errors_;  // px
  std::vector<Band> bands_;
};

}  // namespace ktgp_orb::targets
