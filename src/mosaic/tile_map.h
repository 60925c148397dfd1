#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <map>
#include <opencv2/core.hpp>
#include <utility>

namespace ktgp_orb::mosaic {

/// A picture of unlimited size. Its square tiles exist only where something was drawn, so the
/// memory grows with the covered area.
class TileMap {
 public:
  static constexpr int kTileSize = 256;  ///< px

  explicit TileMap(std::size_t max_tiles) : max_tiles_(max_tiles) {}

  void setMaxTiles(std::size_t max_tiles) { max_tiles_ = max_tiles; }

  /// Draws a frame (CV_8UC3) at the position `to_map` and blends it with the existing picture. The
  /// weight of a pixel falls towards the border of its frame, so there are no seams. Returns false
  /// if a part of the frame would have needed more than `max_tiles`.
  bool draw(const cv::Mat& frame, const Eigen::Matrix3d& to_map);

  /// Factor that gives the frame the brightness of the map below it; 1 if the overlap is too small.
  double gain(const cv::Mat& frame, const Eigen::Matrix3d& to_map) const;

  /// Bounds of the drawn part, px of the map; empty before the first draw().
  const cv::Rect& area() const { return area_; }
  std::size_t tiles() const { return tiles_.size(); }
  /// The area as CV_8UC4, alpha 0 for unseen parts; `scale` in (0, 1] makes it smaller.
  cv::Mat image(double scale) const;
  void clear();

 private:
  struct Tile {
    cv::Mat colour;  // CV_8UC3
    cv::Mat weight;  // CV_16UC1; 0: nothing was drawn
  };
  using Place = std::pair<int, int>;  // column, row

  /// The pixel of the map at `p`; null for unseen parts.
  const cv::Vec3b* at(const Eigen::Vector2d& p) const;
  bool drawTile(const Place& place, const cv::Mat& frame, const Eigen::Matrix3d& to_map);
  void setFeather(const cv::Size& size);

  std::size_t max_tiles_;
  std::map<Place, Tile> tiles_;
  cv::Rect area_;
  cv::Mat feather_;  // CV_8UC1, weight of each pixel of a frame
  cv::Mat patch_;
  cv::Mat patch_weight_;
};

}  // namespace ktgp_orb::mosaic
