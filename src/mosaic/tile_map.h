#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <map>
#include <opencv2/core.hpp>
#include <utility>
#include <vector>

#include "mosaic/surface.h"

namespace ktgp_orb::mosaic {

/// A picture of unlimited size. It consists of square tiles, which exist only in the drawn area, so
/// the memory grows with this area.
class TileMap {
 public:
  static constexpr int kTileSize = 256;  ///< px
  /// Largest bounding rectangle of the drawn area, as a multiple of the area of max_tiles. A
  /// diagonal strip needs few tiles, but image() needs the memory of its rectangle.
  static constexpr std::size_t kMostOfArea = 8;

  explicit TileMap(std::size_t max_tiles) : max_tiles_(max_tiles) {}

  void setMaxTiles(std::size_t max_tiles) { max_tiles_ = max_tiles; }

  /// The surface of the picture; a plane at first and after clear().
  const Surface& surface() const { return surface_; }
  /// Redraws the picture on a cylinder, and draws all further frames there. Returns false and
  /// changes nothing if the picture is too large to be redrawn.
  bool bend(const Surface& cylinder);

  /// Draws a frame (CV_8UC3) and blends it with the existing picture. `to_map`: homography frame ->
  /// first frame, scaled by Surface::scaled(). The weight of a pixel falls towards the border of
  /// its frame, so there are no seams. The picture on a cylinder covers at most one full turn;
  /// parts beyond its end are drawn at its beginning. Returns false if a part was not drawn,
  /// because the map has max_tiles tiles already, or its bounding rectangle would be too large.
  bool draw(const cv::Mat& frame, const Eigen::Matrix3d& to_map);

  /// Returns the factor that makes the frame as bright as the map below it; 1 if they overlap too
  /// little.
  double gain(const cv::Mat& frame, const Eigen::Matrix3d& to_map) const;

  /// A part of the map, as a frame would show it.
  struct View {
    cv::Mat colour;  // CV_8UC3
    cv::Mat mask;    // CV_8UC1, 0 where nothing was drawn
  };
  /// `size`: size of the view, px. `to_map`: as for draw(), for a pixel of the view.
  View view(const cv::Size& size, const Eigen::Matrix3d& to_map) const;

  /// The border of a frame in the map. A cylinder repeats after each full turn, so there the border
  /// is shifted by whole turns to the position nearest to the drawn area.
  std::vector<Eigen::Vector2d> outline(const cv::Size& size, const Eigen::Matrix3d& to_map) const;
  /// Bounds of the drawn area, px of the map; empty at first.
  const cv::Rect& area() const { return area_; }
  std::size_t tiles() const { return tiles_.size(); }
  /// The drawn area as CV_8UC4; alpha is 0 for unseen parts. `scale` in (0, 1] makes the image
  /// smaller.
  cv::Mat image(double scale) const;
  void clear();

 private:
  struct Tile {
    cv::Mat colour;  // CV_8UC3
    cv::Mat weight;  // CV_16UC1; 0: nothing was drawn at this pixel
  };
  using Place = std::pair<int, int>;  // column, row

  /// The pixel of the map at `p`, px of the map; null if nothing was drawn there.
  const cv::Vec3b* at(const Eigen::Vector2d& p) const;
  /// A picture to be drawn, with the weights of its pixels.
  struct Frame {
    const cv::Mat& colour;  // CV_8UC3
    const cv::Mat& weight;  // CV_8UC1
    Eigen::Matrix3d to_map;
  };
  bool draw(const Frame& frame);
  /// Draws the part of the frame that is within `bounds`, px of the map.
  bool drawIn(const cv::Rect& bounds, const Frame& frame);
  bool drawTile(const Place& place, const cv::Rect& bounds, const Frame& frame);
  void setPatchWeight(const cv::Rect& region, const Frame& frame);
  void setPatch(const cv::Rect& region, const Frame& frame);
  bool isTooLarge(const cv::Rect& area) const;
  void setFeather(const cv::Size& size);

  std::size_t max_tiles_;
  Surface surface_;
  std::map<Place, Tile> tiles_;
  cv::Rect area_;
  cv::Mat feather_;     // CV_8UC1, weight of each pixel of a frame
  cv::Mat homography_;  // for a plane: homography frame -> tile
  cv::Mat pixels_;      // for a cylinder: CV_32FC2, position in the frame of each pixel of the tile
  cv::Mat patch_;
  cv::Mat patch_weight_;
};

}  // namespace ktgp_orb::mosaic
