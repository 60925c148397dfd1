#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

#include "targets/target_picture.h"

namespace ktgp_orb::targets {

/// The images of a frame, from large to small.
struct FramePyramid {
  std::vector<cv::Mat> levels;
  double scale_factor = 1.2;  ///< size ratio of neighbouring levels
  double enlargement = 1.0;   ///< px of level 0 per px of the camera
};

/// Compares a picture with the frame under a homography, block by block, by the correlation of grey
/// values. The rate of chance hits is measured: it is the share of pairs that look alike when a
/// block of the picture is compared with a wrong block of the frame nearby. So the blocks of a
/// repetitive picture, which all look alike, are no evidence. Reuses its buffers.
class Appearance {
 public:
  struct Similarity {
    /// log10 of the expected number of pictures that look as similar by chance.
    double log_false_alarms = 0.0;
    double agreement = 0.0;  ///< share of the blocks in view that look alike, 0..1
    bool differs = false;    ///< most blocks with texture in view do not look alike
  };

  /// Minimum ratio of the share of similar blocks at the homography's position to the largest such
  /// share at a nearby position. A facade or a text still looks similar when shifted by one window
  /// or one line. If a track predicts the position, its share only has to be the largest (ratio 1).
  static constexpr double kAboveNeighbours = 1.5;
  static constexpr double kAboveNeighboursOfTrack = 1.0;

  /// `homography`: picture -> level 0 of the frame. `tests`: total number of comparisons (pictures
  /// times homographies).
  Similarity compare(const TargetPicture& picture, const Eigen::Matrix3d& homography,
                     const FramePyramid& frame, double tests,
                     double above_neighbours = kAboveNeighbours);

  /// Share of the blocks that look clearly different, among the blocks with texture in both images
  /// of the last comparison. A different text counts as clearly different; different light or blur
  /// does not. Blocks at the border are left out, because one of the images may be incomplete
  /// there.
  double shareThatDiffers() const;

  /// Shifts a homography by up to `radius` px of the frame to the place where the images look most
  /// alike. Returns false, without a result, if they look different everywhere.
  bool locate(const TargetPicture& picture, const Eigen::Matrix3d& homography,
              const FramePyramid& frame, double radius, Eigen::Matrix3d& located);

 private:
  struct Block {
    bool has_texture = false;
    bool is_seen = true;  // whether the centre of the block is in the frame
    float values[64];     // grey values, normalised to mean 0 and norm 1
  };
  /// Result of comparing the picture with the frame at a shift by (dx, dy) blocks. `pairs`: number
  /// of pairs of blocks whose block of the picture has texture. `hits`: number of these pairs that
  /// look alike.
  struct Agreement {
    double hits = 0.0;
    double pairs = 0.0;
  };
  Agreement agreementAt(int dx, int dy) const;
  Agreement agreementOfDecoys(double fewest, double& largest) const;
  void sample(const TargetPicture& picture, const Eigen::Matrix3d& homography, const cv::Size& size,
              const cv::Size& margin, const FramePyramid& frame);
  void cut(const cv::Mat& image, float least_deviation, std::vector<Block>& blocks) const;
  void markSeen(const Eigen::Matrix3d& homography, const cv::Size& picture, const cv::Size& frame);

  std::size_t blockAt(int column, int row) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) +
           static_cast<std::size_t>(column);
  }

  int columns_ = 0;
  int rows_ = 0;
  cv::Mat picture_, frame_;
  std::vector<Block> of_picture_, of_frame_;
};

}  // namespace ktgp_orb::targets
