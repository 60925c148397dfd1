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
  /// Largest size of the mosaic, 10^6 px, 1..1000. It stops growing at this size, or if its
  /// bounding rectangle would become more than eight times as large; the part that is already
  /// covered is still updated. Memory per pixel: five bytes for the map, and up to twelve bytes for
  /// the keyframes. image() needs four bytes for each pixel of the bounding rectangle.
  double max_megapixels = 64.0;
  /// If true, each frame is matched to the nearest keyframe of the map to find its position. If
  /// false, its position is the product of the homographies given to follow(), whose errors add up.
  bool keyframes = true;
  /// If true, the brightness of each frame is scaled by one factor to match the map. This avoids
  /// steps when the exposure changes or a cloud passes.
  bool gain = true;
  OrbOptions orb;
  MatcherOptions matcher = MatcherOptions::robust();
};

/// What Mosaic::place() did with a frame.
enum class Placement : std::uint8_t {
  drawn,  ///< the position of the frame is known, and it was drawn
  /// The position of the frame is known, but the frame was not drawn, because the view has hardly
  /// moved or the map is full.
  seen,
  new_map,  ///< the frame is the first frame of a new map
  lost,     ///< the position of the frame is not known
};

/// Returns "drawn", "seen", "new_map" or "lost".
const char* toString(Placement placement);

/// Why the last frame is lost.
enum class LostBecause : std::uint8_t {
  nothing,    ///< the frame is not lost
  unmatched,  ///< no homography and no keyframe connects the frame to the map
  repeats,    ///< the pattern of the ground repeats, and it is unknown which part the frame shows
  zoomed,     ///< the frame's scale in the map is not in 1/4..4 (after a large turn, tilt or climb)
  moved,      ///< the map is a panorama, but the camera has not only turned: it has moved
};

/// The cylinder around the camera on which the map is drawn if the camera only turns. Pixel p of
/// the first frame has the ray K_inv p in the camera's coordinates. The ray has the components x to
/// the right, y along `axis`, and z ahead; the z direction lies in the plane of `axis` and the
/// optical axis of the first frame. The pixel is drawn at
/// (cx + fx atan2(x, z), cy + fx y / sqrt(x² + z²)), where fx, cx and cy are entries of K. After a
/// full turn, the same direction is drawn again, 2 pi fx px away from the first place.
struct Panorama {
  Eigen::Matrix3d camera = Eigen::Matrix3d::Identity();  ///< K, px
  Eigen::Vector3d axis = Eigen::Vector3d::UnitY();  ///< rotation axis, in the first camera's frame
  /// True if K was estimated from homographies, not given by setCamera().
  bool is_estimated = false;
  double degrees = 0.0;  ///< horizontal angle that the map covers, 0..360
  /// Largest drift over a full turn, px: the distance between a frame's place according to the
  /// chain of homographies and its place according to the keyframes of the beginning of the turn. 0
  /// if there was no full turn.
  double closed_off = 0.0;
};

/// A picture of a plane, such as the ground below a drone, composed from the frames of a camera.
///
/// A frame is drawn if the view has moved by at least 3 % of its width. The newest frame is also
/// drawn when image() is called or the map is finished. If a frame cannot be connected to the map,
/// this frame and the next frames are searched for in the map. A new map begins only if this fails
/// for a second, and for more than three frames. The coordinates of the map are the pixel
/// coordinates of its first frame, extended beyond the frame on all sides. If the camera has only
/// turned, by more than 20 degrees, the map is drawn on the cylinder of a Panorama. An instance
/// belongs to one thread at a time.
class Mosaic {
 public:
  /// Throws std::invalid_argument, naming the option and its range, if an option is out of range.
  explicit Mosaic(const MosaicOptions& options = {});
  ~Mosaic();
  Mosaic(Mosaic&&) noexcept;
  Mosaic& operator=(Mosaic&&) noexcept;

  const MosaicOptions& options() const;
  /// The new options apply from the next frame on; the map stays. With another kind of descriptors,
  /// its keyframes are dropped, because no frame could be matched to them. Throws like the
  /// constructor.
  void setOptions(const MosaicOptions& options);

  /// Sets the camera matrix K of the images without lens distortion, px; empty if it is not known.
  /// K applies to the next map, and to the current map if this map is still a plane. Without K, a
  /// panorama is possible only if the homographies determine K.
  void setCamera(const std::optional<Eigen::Matrix3d>& camera);

  /// Adds the homography of a frame (reference -> frame, px; empty if none was found). Call this
  /// for every frame, in order, even for frames that you do not pass to place().
  void follow(std::int64_t stamp, std::int64_t reference_stamp,
              const std::optional<Eigen::Matrix3d>& homography);
  /// Places and draws a frame that was added by follow(). `image`: CV_8UC3 (BGR) or CV_8UC1. Throws
  /// std::invalid_argument for an image of another type.
  Placement place(std::int64_t stamp, const cv::Mat& image);

  /// Sets a function that is called with the old map (see image()) before a new map replaces it.
  void onFinishedMap(std::function<void(const cv::Mat&)> callback);

  /// Pose of the last frame given to place(): the homography from the first frame of the map to
  /// this frame, px. Empty if the frame is lost. In a panorama, the homography is K R K_inv, where
  /// R is the rotation of the camera. Its determinant is 1, so that the third coordinate of a
  /// mapped point is positive if the point is in front of the camera.
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
  /// The map as CV_8UC3, shrunk so that no side is longer than `longest` px. Parts that no frame
  /// has shown are dark, and an outline shows the last placed frame.
  cv::Mat picture(int longest) const;
  /// The part of the map that image() shows, px: pixel (0, 0) of the image is at (x, y) of the map.
  /// Call image() first, because it draws the newest frame, which may enlarge the part.
  cv::Rect area() const;

  double megapixels() const;  ///< covered area, 10^6 px, counted in whole tiles
  bool full() const;          ///< true if a part was not drawn because of max_megapixels
  std::size_t keyframes() const;
  std::size_t maps() const;  ///< number of maps that were begun
  /// How far the scene of the newest frames deviates from a plane, px: the running mean of
  /// UncertainHomography::plane_deviation over the matches to keyframes; 0 without keyframes.
  double planeDeviation() const;
  /// Returns true if planeDeviation() is above 0.5 px: near or high objects may then be drawn
  /// several times.
  bool hasParallax() const;

  void reset();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ktgp_orb
