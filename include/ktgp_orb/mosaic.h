#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>

#include "ktgp_orb/ktgp_matcher.h"
#include "ktgp_orb/orb_extractor.h"

namespace ktgp_orb {

struct MosaicOptions {
  /// 10^6 px, 1..1000: the mosaic stops growing there; what it covers is still renewed. A pixel
  /// takes five bytes, and its share of the keyframes up to twelve more.
  double max_megapixels = 64.0;
  /// Whether a frame is placed by a match to the nearest keyframe of the map; else by multiplying
  /// the homographies that are handed in, whose errors add up.
  bool keyframes = true;
  /// Share of a frame that keyframes must cover, 0.2..0.9; one that is covered less becomes one.
  double keyframe_overlap = 0.6;
  /// Share of the width that the view must move before a frame is drawn, 0..1.
  double min_motion = 0.03;
  /// Whether a frame is brought to the brightness of what it overlaps of the map, by one factor: a
  /// camera whose exposure changes, or a cloud, leaves no steps then.
  bool gain = true;
  /// s: a frame that nothing leads to is looked for in the map for as long, then a new map begins.
  double patience = 1.0;
  OrbOptions orb;
  MatcherOptions matcher = MatcherOptions::robust();
};

/// What became of a frame.
enum class Placement : std::uint8_t {
  drawn,    ///< its place is known, and it is part of the map
  seen,     ///< its place is known; it has hardly moved, or there is no room for it
  new_map,  ///< it is the first of a new map
  lost,     ///< its place is not known
};

/// "drawn", "seen", "new_map", "lost"
const char* toString(Placement placement);

/// A picture of a plane, the ground below a drone for example, made of the frames of a camera.
///
/// Coordinates of the map are those of its first frame, in px, and go on beyond it on all sides.
/// An instance belongs to one thread at a time.
class Mosaic {
 public:
  /// Throws std::invalid_argument naming the option and its range.
  explicit Mosaic(const MosaicOptions& options = {});
  ~Mosaic();
  Mosaic(Mosaic&&) noexcept;
  Mosaic& operator=(Mosaic&&) noexcept;

  const MosaicOptions& options() const;
  /// From the next frame on; the map stays. Throws as the constructor does.
  void setOptions(const MosaicOptions& options);

  /// Tells how a frame lies to its reference (reference -> frame, px), whether or not it is placed:
  /// call it for every frame, in their order. Nothing: no homography was found.
  void follow(std::int64_t stamp, std::int64_t reference_stamp,
              const std::optional<Eigen::Matrix3d>& homography);
  /// Finds the place of a frame that was followed, and draws it. `image`: CV_8UC3 (BGR) or CV_8UC1.
  /// Throws std::invalid_argument for another type.
  Placement place(std::int64_t stamp, const cv::Mat& image);

  /// Called with the map, as image() gives it, before a new one takes its place.
  void onFinishedMap(std::function<void(const cv::Mat&)> callback);

  /// Of the frame that was placed last: map -> frame, px; nothing where it is lost.
  std::optional<Eigen::Matrix3d> pose() const;
  /// First frame of the map, ns.
  std::int64_t firstStamp() const;

  /// The map, CV_8UC4: BGR, and alpha 0 where nothing was seen yet; empty where nothing was drawn.
  cv::Mat image() const;
  /// The same, no side longer than `longest` px, CV_8UC3, dark where nothing was seen yet, with the
  /// outline of the frame that was placed last.
  cv::Mat picture(int longest) const;
  /// What image() covers of the map, px.
  cv::Rect area() const;

  double megapixels() const;  ///< covered, in whole tiles
  bool full() const;          ///< something could not be drawn for want of room
  std::size_t keyframes() const;
  std::size_t maps() const;  ///< begun so far

  void reset();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ktgp_orb
