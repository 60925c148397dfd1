#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <deque>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "ktgp_orb/frame_path.h"

namespace ktgp_orb {

struct StabilizerOptions {
  /// s, > 0: motion that is quicker is shake and is taken out; motion that is slower is the path.
  double strength = 0.5;
  /// Frames that the picture waits for what comes after it, 0..60: more is steadier, and later.
  int lag = 0;
  /// Share of width and height, at each border, that may be cut off, 0.01..0.4. No picture shows
  /// anything beyond the border of its frame: shake that needs more is left in, gently.
  double max_crop = 0.1;
};

/// A frame that has its place in the steady picture.
struct SteadyFrame {
  std::int64_t stamp = 0;
  /// Frame -> steady picture of the same size, px.
  Eigen::Matrix3d warp = Eigen::Matrix3d::Identity();
  /// Nothing connects it to the frame before: a scene cut, or no homography was found.
  bool starts_anew = false;
};

/// Smooths the path of a camera while it goes.
///
/// The corners of a frame are followed through the frames around it (Matsushita et al., "Full-frame
/// video stabilization with motion inpainting", PAMI 2006); where a straight line through these
/// tracks, weighted by how near in time a frame is, has them at the frame's own time, there the
/// steady picture shows the corners. A line, no mean: a camera that moves on evenly is followed
/// without delay. Where the path starts anew, what was corrected last fades out.
///
/// An instance belongs to one thread at a time.
class Stabilizer {
 public:
  /// Throws std::invalid_argument naming the option and its range.
  explicit Stabilizer(const StabilizerOptions& options = {});

  const StabilizerOptions& options() const { return options_; }
  /// From the next frame on; the path goes on. Throws as the constructor does.
  void setOptions(const StabilizerOptions& options);

  /// The next frame, of `size` px, taken at `stamp` ns. `homography`: reference -> frame; nothing:
  /// none was found. Appends to `ready` the frames whose place is now known, oldest first: that
  /// of `lag` frames ago, or all that waited and then this one where the path starts anew.
  void add(std::int64_t stamp, std::int64_t reference_stamp,
           const std::optional<Eigen::Matrix3d>& homography, const cv::Size& size,
           std::vector<SteadyFrame>& ready);
  /// Appends what still waits.
  void flush(std::vector<SteadyFrame>& ready);
  /// As if nothing had come.
  void reset();

 private:
  using Corners = std::array<Eigen::Vector2d, 4>;

  struct Waiting {
    std::int64_t stamp = 0;
    bool starts_anew = false;
  };

  void finishOldest(std::vector<SteadyFrame>& ready);
  Corners smoothed(std::int64_t stamp, const Eigen::Matrix3d& to_newest) const;
  Eigen::Matrix3d limited(const Corners& wanted);

  StabilizerOptions options_;
  FramePath path_;
  cv::Size size_;
  std::deque<Waiting> waiting_;
  Corners correction_;  // of the newest finished frame, where its corners moved to, px
  Corners fading_;      // what is left of the correction before the path started anew
  std::int64_t fading_since_ = 0;
};

/// How unsteady a path is: mean over time and corners of the squared second difference of where the
/// image corners are, px^2. `steps`: homographies from each frame to the next; 0 for fewer than 2.
double shakeOf(const std::vector<Eigen::Matrix3d>& steps, const cv::Size& size);

}  // namespace ktgp_orb
