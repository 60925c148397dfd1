#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

#include "targets/target_picture.h"

namespace ktgp_orb::targets {

/// The image of a frame at several sizes, the largest first.
struct FramePyramid {
  std::vector<cv::Mat> levels;
  double scale_factor = 1.2;  ///< size ratio of neighbouring levels
  double enlargement = 1.0;   ///< size of level 0 divided by the size of the camera image
};

/// Compares a picture, mapped to the frame by a homography, with the frame, block by block: two
/// blocks look alike (a hit) if their grey values correlate. Also measures the rate of chance hits:
/// the share of hits when the blocks of the picture are compared with wrong blocks of the frame
/// nearby. If all blocks of a picture look alike, this rate is high, so its hits give no evidence.
/// Reuses its buffers.
class Appearance {
 public:
  struct Similarity {
    /// log10 of the expected number of pictures that look as similar by chance; infinite if too few
    /// blocks look alike.
    double log_false_alarms = 0.0;
    double agreement = 0.0;  ///< share of the textured blocks in view that look alike, 0..1
    bool differs = false;    ///< true if fewer than 30 % of 12 or more such blocks look alike
  };

  /// The share of blocks that look alike at the homography's position must be at least this many
  /// times as large as at any nearby position, because a facade or a text still looks similar when
  /// shifted by one window or one line. If a track predicts the position, the share only has to be
  /// the largest (factor 1).
  static constexpr double kAboveNeighbours = 1.5;
  static constexpr double kAboveNeighboursOfTrack = 1.0;

  /// `homography`: picture -> level 0 of the frame. `tests`: number of comparisons that may give a
  /// false alarm (pictures times homographies). `above_neighbours`: kAboveNeighbours or
  /// kAboveNeighboursOfTrack.
  Similarity compare(const TargetPicture& picture, const Eigen::Matrix3d& homography,
                     const FramePyramid& frame, double tests,
                     double above_neighbours = kAboveNeighbours);

  /// Returns how many blocks looked clearly different in the last compare(), as a share of the
  /// blocks that have texture in both images. A different text counts as clearly different;
  /// different light or blur does not. Blocks at the border are left out, because one of the images
  /// may be incomplete there.
  double shareThatDiffers() const;

  /// Shifts a homography by up to `radius` px of the frame to the place where the images look most
  /// alike. Returns false, without a result, if they look different everywhere.
  bool locate(const TargetPicture& picture, const Eigen::Matrix3d& homography,
              const FramePyramid& frame, double radius, Eigen::Matrix3d& located);

 private:
  struct Block {
    bool has_texture = false;
    bool is_seen = true;  // true if the centre of the block is in the frame
    float values[64];     // grey values, normalised to mean 0 and norm 1
  };
  /// Result of agreementAt(dx, dy), which compares each textured block of the picture with the
  /// block of the frame that is (dx, dy) blocks farther on. `pairs`: number of comparisons. `hits`:
  /// number of comparisons in which the two blocks look alike.
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
