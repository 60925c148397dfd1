#include "mosaic/tile_map.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <opencv2/core/eigen.hpp>
#include <opencv2/imgproc.hpp>

#include "homography/transform.h"

namespace ktgp_orb::mosaic {
namespace {

// Limit of a pixel's weight. The existing picture counts as at most three frames, so new content
// appears soon and noise averages out.
constexpr int kMaxWeight = 3 * 255;

// gain() compares the pixels of a grid with this spacing. Pixels that are darker than kDark or
// brighter than kBright are left out, because they may be clipped.
constexpr int kGainStep = 8;  // px
constexpr int kLeastGainSamples = 100;
constexpr int kDark = 8;
constexpr int kBright = 247;
constexpr double kLargestGain = 4.0;

int tileOf(double coordinate) {
  return static_cast<int>(std::floor(coordinate / TileMap::kTileSize));
}

/// The smallest rectangle of whole pixels that contains the points.
cv::Rect boundsOf(const std::vector<Eigen::Vector2d>& points) {
  Eigen::AlignedBox2d box;
  for (const Eigen::Vector2d& point : points) box.extend(point);
  const Eigen::Vector2d low = box.min().array().floor();
  const Eigen::Vector2d high = box.max().array().ceil() + 1.0;
  return {cv::Point(static_cast<int>(low.x()), static_cast<int>(low.y())),
          cv::Point(static_cast<int>(high.x()), static_cast<int>(high.y()))};
}

Eigen::Vector2d middleOf(const cv::Rect& area) {
  return {area.x + 0.5 * area.width, area.y + 0.5 * area.height};
}

bool isExposed(const cv::Vec3b& pixel) {
  return std::all_of(pixel.val, pixel.val + 3,
                     [](int value) { return value >= kDark && value <= kBright; });
}

int sumOf(const cv::Vec3b& pixel) {
  return pixel[0] + pixel[1] + pixel[2];
}

void blendRow(const std::uint8_t* colour, const std::uint8_t* weight, int count,
              std::uint8_t* map_colour, std::uint16_t* map_weight) {
  for (int x = 0; x < count; ++x) {
    const int added = weight[x];
    if (added == 0) continue;
    const int before = map_weight[x];
    const int sum = before + added;
    for (int c = 3 * x; c < 3 * x + 3; ++c) {
      map_colour[c] =
          static_cast<std::uint8_t>((before * map_colour[c] + added * colour[c] + sum / 2) / sum);
    }
    map_weight[x] = static_cast<std::uint16_t>(std::min(sum, kMaxWeight));
  }
}

}  // namespace

void TileMap::setFeather(const cv::Size& size) {
  if (feather_.size() == size) return;
  feather_.create(size, CV_8UC1);
  const double reach = 0.25 * std::min(size.width, size.height);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      const int border = std::min({x, y, size.width - 1 - x, size.height - 1 - y});
      const double share = std::min(1.0, (border + 1) / reach);
      feather_.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>(std::max(1.0, 255.0 * share));
    }
  }
}

const cv::Vec3b* TileMap::at(const Eigen::Vector2d& p) const {
  const Place place(tileOf(p.x()), tileOf(p.y()));
  const auto found = tiles_.find(place);
  if (found == tiles_.end()) return nullptr;
  const int x = static_cast<int>(std::floor(p.x())) - place.first * kTileSize;
  const int y = static_cast<int>(std::floor(p.y())) - place.second * kTileSize;
  if (found->second.weight.at<std::uint16_t>(y, x) == 0) return nullptr;
  return found->second.colour.ptr<cv::Vec3b>(y, x);
}

double TileMap::gain(const cv::Mat& frame, const Eigen::Matrix3d& to_map) const {
  double of_map = 0.0;
  double of_frame = 0.0;
  int samples = 0;
  const Eigen::Vector2d middle = middleOf(area_);
  for (int y = kGainStep / 2; y < frame.rows; y += kGainStep) {
    for (int x = kGainStep / 2; x < frame.cols; x += kGainStep) {
      const auto& pixel = frame.at<cv::Vec3b>(y, x);
      const Eigen::Vector2d place = surface_.toMap(to_map * Eigen::Vector3d(x, y, 1.0));
      const cv::Vec3b* drawn = at(surface_.near(place, middle));
      if (drawn == nullptr || !isExposed(pixel) || !isExposed(*drawn)) continue;
      of_map += sumOf(*drawn);
      of_frame += sumOf(pixel);
      ++samples;
    }
  }
  if (samples < kLeastGainSamples) return 1.0;
  return std::clamp(of_map / of_frame, 1.0 / kLargestGain, kLargestGain);
}

TileMap::View TileMap::view(const cv::Size& size, const Eigen::Matrix3d& to_map) const {
  // A pixel may cover several pixels of the map, so it is the mean of four positions in it.
  constexpr double kOff = 0.25;
  const Eigen::Vector3d offsets[] = {
      {-kOff, -kOff, 0.0}, {kOff, -kOff, 0.0}, {-kOff, kOff, 0.0}, {kOff, kOff, 0.0}};
  constexpr int kSamples = 4;
  View view{cv::Mat::zeros(size, CV_8UC3), cv::Mat::zeros(size, CV_8UC1)};
  const Eigen::Vector2d middle = middleOf(area_);
  for (int y = 0; y < size.height; ++y) {
    for (int x = 0; x < size.width; ++x) {
      cv::Vec3i sum(0, 0, 0);
      int samples = 0;
      for (; samples < kSamples; ++samples) {
        const Eigen::Vector3d pixel = Eigen::Vector3d(x, y, 1.0) + offsets[samples];
        const Eigen::Vector2d place = surface_.toMap(to_map * pixel);
        const cv::Vec3b* drawn = at(surface_.near(place, middle) + Eigen::Vector2d::Constant(0.5));
        if (drawn == nullptr) break;
        sum += cv::Vec3i(*drawn);
      }
      if (samples < kSamples) continue;
      view.colour.at<cv::Vec3b>(y, x) = cv::Vec3b(sum / kSamples);
      view.mask.at<std::uint8_t>(y, x) = 255;
    }
  }
  return view;
}

std::vector<Eigen::Vector2d> TileMap::outline(const cv::Size& size,
                                              const Eigen::Matrix3d& to_map) const {
  std::vector<Eigen::Vector2d> points = surface_.outline(size, to_map);
  if (surface_.isPlane() || area_.empty()) return points;
  const Eigen::Vector2d first = points.front();
  const Eigen::Vector2d moved = surface_.near(first, middleOf(area_)) - first;
  for (Eigen::Vector2d& point : points) point += moved;
  return points;
}

bool TileMap::draw(const cv::Mat& frame, const Eigen::Matrix3d& to_map) {
  setFeather(frame.size());
  return draw({frame, feather_, to_map});
}

bool TileMap::draw(const Frame& frame) {
  cv::Rect bounds = boundsOf(outline(frame.colour.size(), frame.to_map));
  if (surface_.isPlane()) return drawIn(bounds, frame);
  // Add a margin, because the curved sides of the frame may bulge beyond the polygon of outline().
  bounds = {bounds.tl() - cv::Point(2, 2), bounds.br() + cv::Point(2, 2)};
  const int turn = static_cast<int>(surface_.period());
  cv::Rect allowed = bounds;
  if (!area_.empty()) {
    allowed.x = area_.br().x - turn;
    allowed.width = 2 * turn - area_.width;
  }
  bool all = drawIn(bounds & allowed, frame);
  for (const int shift : {-turn, turn}) {
    all = drawIn((bounds + cv::Point(shift, 0)) & area_, frame) && all;
  }
  return all;
}

bool TileMap::drawIn(const cv::Rect& bounds, const Frame& frame) {
  bool all = true;
  if (bounds.empty()) return all;
  for (int row = tileOf(bounds.y); row <= tileOf(bounds.br().y - 1); ++row) {
    for (int column = tileOf(bounds.x); column <= tileOf(bounds.br().x - 1); ++column) {
      all = drawTile({column, row}, bounds, frame) && all;
    }
  }
  return all;
}

/// Computes patch_weight_: the weight of the frame at each pixel of `region`, the area of a tile in
/// the map. Also stores the mapping between the pixels of the tile and of the frame (homography_
/// or pixels_), which setPatch() uses.
void TileMap::setPatchWeight(const cv::Rect& region, const Frame& frame) {
  if (surface_.isPlane()) {
    Eigen::Matrix3d to_tile = Eigen::Matrix3d::Identity();
    to_tile(0, 2) = -region.x;
    to_tile(1, 2) = -region.y;
    cv::eigen2cv(Eigen::Matrix3d(to_tile * frame.to_map), homography_);
    cv::warpPerspective(frame.weight, patch_weight_, homography_, region.size(), cv::INTER_LINEAR);
    return;
  }
  constexpr float kNowhere = -1e4F;  // px, a coordinate outside of any frame
  pixels_.create(region.size(), CV_32FC2);
  const Eigen::Matrix3d from_map = frame.to_map.inverse();
  for (int x = 0; x < region.width; ++x) {
    // Along the axis of the cylinder, the ray changes by the same step from each pixel to the next.
    Eigen::Vector3d ray = from_map * surface_.fromMap({region.x + x, region.y});
    const Eigen::Vector3d step = from_map * surface_.fromMap({region.x + x, region.y + 1}) - ray;
    for (int y = 0; y < region.height; ++y, ray += step) {
      auto& pixel = pixels_.at<cv::Vec2f>(y, x);
      pixel = {kNowhere, kNowhere};
      if (ray.z() <= 0.0) continue;
      const Eigen::Vector2d p = ray.hnormalized().cwiseMax(kNowhere).cwiseMin(-kNowhere);
      pixel = {static_cast<float>(p.x()), static_cast<float>(p.y())};
    }
  }
  cv::remap(frame.weight, patch_weight_, pixels_, cv::noArray(), cv::INTER_LINEAR);
}

/// Computes patch_: the colour of the frame at each pixel of `region`. Repeats the last pixels
/// beyond the border of the frame, because interpolation with black would darken the rim.
void TileMap::setPatch(const cv::Rect& region, const Frame& frame) {
  if (surface_.isPlane()) {
    cv::warpPerspective(frame.colour, patch_, homography_, region.size(), cv::INTER_LINEAR,
                        cv::BORDER_REPLICATE);
  } else {
    cv::remap(frame.colour, patch_, pixels_, cv::noArray(), cv::INTER_LINEAR, cv::BORDER_REPLICATE);
  }
}

bool TileMap::drawTile(const Place& place, const cv::Rect& bounds, const Frame& frame) {
  const cv::Rect region(place.first * kTileSize, place.second * kTileSize, kTileSize, kTileSize);
  setPatchWeight(region, frame);
  cv::Rect covered = cv::boundingRect(patch_weight_);
  if (!surface_.isPlane()) covered &= bounds - region.tl();
  if (covered.empty()) return true;
  const cv::Rect drawn = covered + region.tl();
  const cv::Rect grown = area_.empty() ? drawn : area_ | drawn;
  if (grown != area_ && isTooLarge(grown)) return false;
  auto found = tiles_.find(place);
  if (found == tiles_.end()) {
    if (tiles_.size() >= max_tiles_) return false;
    found = tiles_
                .emplace(place, Tile{cv::Mat::zeros(region.size(), CV_8UC3),
                                     cv::Mat::zeros(region.size(), CV_16UC1)})
                .first;
  }
  setPatch(region, frame);
  Tile& tile = found->second;
  const int x = covered.x;
  for (int y = covered.y; y < covered.br().y; ++y) {
    blendRow(patch_.ptr<cv::Vec3b>(y, x)->val, patch_weight_.ptr<std::uint8_t>(y, x), covered.width,
             tile.colour.ptr<cv::Vec3b>(y, x)->val, tile.weight.ptr<std::uint16_t>(y, x));
  }
  area_ = grown;
  return true;
}

bool TileMap::isTooLarge(const cv::Rect& area) const {
  const double largest = static_cast<double>(kMostOfArea * max_tiles_) * kTileSize * kTileSize;
  return static_cast<double>(area.width) * area.height > largest;
}

bool TileMap::bend(const Surface& cylinder) {
  constexpr int kLongest = 32767;  // px; cv::remap accepts only smaller pictures
  if (std::max(area_.width, area_.height) >= kLongest) return false;
  cv::Mat colour = cv::Mat::zeros(area_.size(), CV_8UC3);
  cv::Mat weight = cv::Mat::zeros(area_.size(), CV_8UC1);
  for (const auto& [place, tile] : tiles_) {
    const cv::Point corner(place.first * kTileSize, place.second * kTileSize);
    const cv::Rect part = cv::Rect(corner, tile.colour.size()) & area_;
    tile.colour(part - corner).copyTo(colour(part - area_.tl()));
    tile.weight(part - corner).convertTo(weight(part - area_.tl()), CV_8UC1, 255.0 / kMaxWeight);
  }
  // Removes the rim of the picture, because interpolation would mix it with the empty pixels beside
  // it.
  cv::erode(weight, weight, cv::noArray());
  Eigen::Matrix3d to_map = Eigen::Matrix3d::Identity();
  to_map.topRightCorner<2, 1>() << area_.x, area_.y;
  clear();
  surface_ = cylinder;
  draw({colour, weight, to_map});
  return true;
}

cv::Mat TileMap::image(double scale) const {
  const auto scaled = [scale](int x) { return static_cast<int>(std::lround(scale * x)); };
  const cv::Size size(std::max(1, scaled(area_.width)), std::max(1, scaled(area_.height)));
  if (area_.empty()) return {};
  cv::Mat all = cv::Mat::zeros(size, CV_8UC4);
  cv::Mat tile_image;
  cv::Mat smaller;
  for (const auto& [place, tile] : tiles_) {
    const cv::Rect region(place.first * kTileSize, place.second * kTileSize, kTileSize, kTileSize);
    const cv::Rect part = region & area_;
    const cv::Point first(scaled(part.x - area_.x), scaled(part.y - area_.y));
    const cv::Point last(scaled(part.br().x - area_.x), scaled(part.br().y - area_.y));
    const cv::Rect target = cv::Rect(first, last) & cv::Rect({0, 0}, size);
    if (target.empty()) continue;
    const cv::Rect inside = part - region.tl();
    cv::Mat alpha;
    cv::compare(tile.weight(inside), 0, alpha, cv::CMP_GT);
    const cv::Mat colour = tile.colour(inside);
    cv::Mat planes[] = {colour, alpha};
    tile_image.create(inside.size(), CV_8UC4);
    const int order[] = {0, 0, 1, 1, 2, 2, 3, 3};
    cv::mixChannels(planes, 2, &tile_image, 1, order, 4);
    if (target.size() == inside.size()) {
      tile_image.copyTo(all(target));
    } else {
      cv::resize(tile_image, smaller, target.size(), 0, 0, cv::INTER_AREA);
      smaller.copyTo(all(target));
    }
  }
  return all;
}

void TileMap::clear() {
  tiles_.clear();
  area_ = {};
  surface_ = {};
}

}  // namespace ktgp_orb::mosaic
