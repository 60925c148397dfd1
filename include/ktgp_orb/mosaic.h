#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <string>

#include "ktgp_orb/ktgp_matcher.h"
#include "ktgp_orb/orb_extractor.h"

namespace ktgp_orb {

struct MosaicOptions {
  /// Largest size of the mosaic, 10^6 px, 1..1000. At this size it stops growing, but the part that
  /// is already covered is still updated. Memory per pixel: five bytes for the map, and up to
  /// twelve bytes for the keyframes.
  double max_megapixels = 64.0;
  /// If true, a frame is placed by a match to the nearest keyframe of the map. If false, a frame is
  /// placed by the product of the given homographies, whose errors add up.
  bool keyframes = true;
  /// If true, the brightness of each frame is scaled by one factor to match the map. This avoids
  /// steps when the exposure changes or a cloud passes.
  bool gain = true;
  OrbOptions orb;
  MatcherOptions matcher = MatcherOptions::robust();
};

/// Outcome for a frame.
enum class Placement : std::uint8_t {
  drawn,  ///< the position of the frame is known, and it was drawn
  /// The position of the frame is known, but the view has hardly moved, or the map is full.
  seen,
  new_map,  ///< the frame is the first one of a new map
  lost,     ///< the position of the frame is not known
};

/// "drawn", "seen", "new_map", "lost"
const char* toString(Placement placement);

/// Why the last frame is lost.
enum class LostBecause : std::uint8_t {
  nothing,    ///< the frame is not lost
  unmatched,  ///< no homography and no keyframe connects the frame to the map
  repeats,    ///< the pattern of the ground repeats, and it is unknown which part the frame shows
  zoomed,     ///< the frame's scale in the map is not within 1/4..4 (large turn, tilt or climb)
  moved,      ///< the map is a panorama, but the camera has left its place
};

/// If the camera only turns, the map is drawn on a cylinder around the camera. Pixel p of the first
/// frame has the ray K_inv p in the camera's coordinates. The ray has the components x to the
/// right, y along `axis`, and z ahead; the z direction lies in the plane of `axis` and the optical
/// axis of the first frame. The pixel is drawn at (cx + fx atan2(x, z), cy + fx y / |x,z|), plus
/// any number of full turns.
struct Panorama {
  Eigen::Matrix3d camera = Eigen::Matrix3d::Identity();  ///< K
  Eigen::Vector3d axis = Eigen::Vector3d::UnitY();  ///< axis of the turn, in the first camera frame
  bool is_estimated = false;  ///< K was estimated from homographies, not given by setCamera()
  double degrees = 0.0;       ///< horizontal angle that the map covers, 0..360
  double closed_off = 0.0;    ///< largest gap between the end and the beginning of a full turn, px
};

/// A picture of a plane, such as the ground below a drone, composed from the frames of a camera.
///
/// A frame is drawn if the view has moved by at least 3 % of its width. The newest frame is also
/// drawn when image() is called or the map is finished. If a frame cannot be connected to the map,
/// this frame and the next frames are searched for in the map. A new map begins only if this fails
/// for a second, and for at least three frames. The coordinates of the map are the pixel
/// coordinates of its first frame, extended beyond the frame on all sides. If the camera has only
/// turned, by more than 20 degrees, the map is drawn on the cylinder of a Panorama. An instance
/// belongs to one thread at a time.
class Mosaic {
 public:
  /// Throws std::invalid_argument naming the option and its range.
  explicit Mosaic(const MosaicOptions& options = {});
  ~Mosaic();
  Mosaic(Mosaic&&) noexcept;
  Mosaic& operator=(Mosaic&&) noexcept;

  const MosaicOptions& options() const;
  /// The new options apply from the next frame on; the map stays. Throws like the constructor.
  void setOptions(const MosaicOptions& options);

  /// K of the images without distortion, px; empty if it is not known. Applies to the next map, and
  /// to the current map if this map is still a plane. Without K, a panorama is possible only if the
  /// homographies determine K.
  void setCamera(const std::optional<Eigen::Matrix3d>& camera);

  /// Adds the homography of a frame (reference -> frame, px; empty if none was found). Call it for
  /// every frame, in order, also for frames that are not placed.
  void follow(std::int64_t stamp, std::int64_t reference_stamp,
              const std::optional<Eigen::Matrix3d>& homography);
  /// Places and draws a frame that was added by follow(). `image`: CV_8UC3 (BGR) or CV_8UC1. Throws
  /// std::invalid_argument for an image of another type.
  Placement place(std::int64_t stamp, const cv::Mat& image);

  /// Sets a function that is called with the old map (see image()) before a new map replaces it.
  void onFinishedMap(std::function<void(const cv::Mat&)> callback);

  /// Pose of the last frame given to place(): the homography from the first frame of the map to
  /// this frame, px. Empty if the frame is lost. In a panorama, the homography is K R K_inv with
  /// determinant 1, so that points of the first frame's plane with a positive third coordinate are
  /// in front of the camera.
  std::optional<Eigen::Matrix3d> pose() const;
  /// Reason why the last frame is lost.
  LostBecause lostBecause() const;
  /// If the reason is zoomed or moved: the reason as text for users, with the results of the tests
  /// that led to it. Otherwise empty.
  std::string whyLost() const;
  /// The cylinder that the map is drawn on; empty if the map is a plane.
  std::optional<Panorama> panorama() const;
  /// Stamp of the first frame of the map, ns.
  std::int64_t firstStamp() const;

  /// The map as CV_8UC4 (BGR and alpha; alpha is 0 in parts that no frame has shown). It is empty
  /// before the first frame is drawn.
  cv::Mat image() const;
  /// The map as CV_8UC3, with no side longer than `longest` px. Parts that no frame has shown are
  /// dark, and an outline shows the last placed frame.
  cv::Mat picture(int longest) const;
  /// The part of the map that image() shows, px.
  cv::Rect area() const;

  double megapixels() const;  ///< covered area, 10^6 px, counted in whole tiles
  bool full() const;          ///< whether a part was not drawn because max_megapixels is reached
  std::size_t keyframes() const;
  std::size_t maps() const;  ///< number of maps that were begun
  /// How far the scene of the newest frames deviates from a plane, px: the running mean of
  /// UncertainHomography::plane_deviation of their matches to keyframes; 0 without keyframes.
  double planeDeviation() const;
  /// Whether planeDeviation() is large enough to draw near or high objects several times.
  bool hasParallax() const;

  void reset();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ktgp_orb
