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

  /// Grows the homography of the whole picture from a map that is right near one position.
  /// `centre`: that position, px of the picture. `map`: picture -> frame, affine. True: `estimate`
  /// is the homography. False: too few patches agree around the position.
  bool grow(const TargetPicture& picture, const std::vector<cv::Mat>& frame,
            const Eigen::Vector2d& centre, const Eigen::Matrix3d& map,
            UncertainHomography& estimate);

  /// `frame`: pyramid of the frame, not empty. `estimate`: picture -> frame, px; its error is at
  /// most about 4 px. True: `estimate` is corrected, and `pairs` are the pairs of points to which
  /// it was fitted. False: both are unchanged, since too few patches were found again, or they do
  /// not agree on a homography.
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

  /// Rows of the frame that are exposed at about the same time, and the patches in them.
  struct Band {
    double count = 0.0;
    Eigen::Vector2d error = Eigen::Vector2d::Zero();                          // sum, px
    Eigen::Matrix<double, 2, 8> slope = Eigen::Matrix<double, 2, 8>::Zero();  // sum
    Eigen::Matrix<double, 8, 8> information = Eigen::Matrix<double, 8, 8>::Zero();
  };

  alignment::PatchAligner aligner_;
  homography::HomographyRefiner refiner_;
  cv::Mat shrunk_;              // the picture at the size that it has in the frame
  std::vector<cv::Mat> small_;  // pyramid with one level: shrunk_ with a border
  cv::Size size_;               // size of the picture without the border
  std::vector<Eigen::Vector2d> reference_, target_;
  std::vector<double> errors_;  // px
  std::vector<Band> bands_;
};

}  // namespace ktgp_orb::targets
