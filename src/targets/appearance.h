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
/// values. The rate of chance hits is measured: how often a block of the picture looks like a block
/// of the frame near its own place. So the blocks of a repetitive picture, which all look alike,
/// are no evidence. Reuses its buffers.
class Appearance {
 public:
  struct Similarity {
    /// log10 of the expected number of pictures that look as similar by chance.
    double log_false_alarms = 0.0;
    double agreement = 0.0;  ///< share of the blocks in view that look alike, 0..1
    bool differs = false;    ///< most blocks in view have texture and do not look alike
  };

  /// Factor by which more blocks must look alike at their own place than at any place nearby: a
  /// facade or lines of text nearly look alike one window or one line further. If a track predicts
  /// the place, this place must only be the best.
  static constexpr double kAboveNeighbours = 1.5;
  static constexpr double kAboveNeighboursOfTrack = 1.0;

  /// `homography`: picture -> level 0 of the frame. `tests`: how many pictures and homographies are
  /// compared in all.
  Similarity compare(const TargetPicture& picture, const Eigen::Matrix3d& homography,
                     const FramePyramid& frame, double tests,
                     double above_neighbours = kAboveNeighbours);

  /// Share of the blocks that look clearly different, among the blocks with texture in both images
  /// of the last comparison. Another text differs clearly; another light or blur does not. Blocks
  /// at the border are left out, because one of the images may show less there.
  double shareThatDiffers() const;

  /// Moves a homography by up to `radius` px of the frame to where the images look most alike.
  /// False, without a result, if the images look different everywhere.
  bool locate(const TargetPicture& picture, const Eigen::Matrix3d& homography,
              const FramePyramid& frame, double radius, Eigen::Matrix3d& located);

 private:
  struct Block {
    bool has_texture = false;
    bool is_seen = true;  // the block is in the frame
    float values[64];     // mean 0, length 1
  };
  /// Comparison of the picture with the frame (dx, dy) blocks away: `pairs` of blocks with texture
  /// in the picture, and `hits` among them, which look alike.
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
