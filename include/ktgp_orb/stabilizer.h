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
  /// Time scale of the smoothing, s, 0.01..10. Faster motion is shake and removed; slower is kept.
  double strength = 0.4;
  /// Number of later frames to wait for before a frame is returned, 0..60. A larger lag gives a
  /// steadier picture but more delay.
  int lag = 0;
  /// The largest share of the width or height that may be cut off at each border, 0.01..0.4. A
  /// correction that would need more is reduced smoothly, so that no area beyond the frame is
  /// shown.
  double max_crop = 0.1;
};

/// A frame, and where it has to be drawn in the steady picture.
struct SteadyFrame {
  std::int64_t stamp = 0;
  /// Homography from the frame to the steady picture of the same size, px.
  Eigen::Matrix3d warp = Eigen::Matrix3d::Identity();
  /// True if the frame is not connected to the previous frame, because the scene was cut or no
  /// homography was found.
  bool starts_anew = false;
};

/// Smooths the path of a camera online.
///
/// Follows the corners of each frame through the neighbouring frames (Matsushita et al.,
/// "Full-frame video stabilization with motion inpainting", PAMI 2006). Fits a straight line over
/// time to the track of each corner; frames that are nearer in time have more weight. The line's
/// position at the time of the frame is the position of the corner in the steady picture. (With the
/// mean of the track instead of a line, the picture would lag behind a camera that moves evenly.)
/// With a lag of 0, the camera is assumed to stand still at the beginning of a path, until more
/// frames are known. When a new path begins, the last correction of the old path fades out.
///
/// An instance belongs to one thread at a time.
class Stabilizer {
 public:
  /// Throws std::invalid_argument, naming the option and its range, if an option is out of range.
  explicit Stabilizer(const StabilizerOptions& options = {});

  const StabilizerOptions& options() const { return options_; }
  /// The new options apply from the next frame on; the path continues. Throws like the constructor.
  void setOptions(const StabilizerOptions& options);

  /// Adds the next frame, of `size` px, taken at `stamp` ns. `homography`: reference -> frame;
  /// empty if none was found. Appends the frames whose positions are now known to `ready`, oldest
  /// first. Usually this is the frame that was added `lag` frames ago. If a new path begins, all
  /// waiting frames are appended first.
  void add(std::int64_t stamp, std::int64_t reference_stamp,
           const std::optional<Eigen::Matrix3d>& homography, const cv::Size& size,
           std::vector<SteadyFrame>& ready);
  /// Appends to `ready` the frames that still wait for later frames.
  void flush(std::vector<SteadyFrame>& ready);
  /// Returns to the initial state.
  void reset();

 private:
  using Corners = std::array<Eigen::Vector2d, 4>;

  void finishOldest(std::vector<SteadyFrame>& ready);
  Corners smoothed(std::int64_t stamp, const Eigen::Matrix3d& to_newest) const;
  Eigen::Matrix3d limited(const Corners& wanted);

  StabilizerOptions options_;
  FramePath path_;
  cv::Size size_;
  std::deque<SteadyFrame> waiting_;  // frames whose warps are not known yet
  // How far the correction shifts each corner of the newest finished frame, before the crop, px.
  Corners correction_;
  // Correction at the end of the previous path; it fades out in the present path.
  Corners fading_;
  std::int64_t fading_since_ = 0;
};

/// Measures the shake of a path: the squared second difference of the positions of the image
/// corners, averaged over the frames and the four corners, px². `steps`: homographies from each
/// frame to the next. Returns 0 for fewer than two steps.
double shakeOf(const std::vector<Eigen::Matrix3d>& steps, const cv::Size& size);

}  // namespace ktgp_orb
