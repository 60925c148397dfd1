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

// Distance between samples for the gain. Very dark or bright pixels, maybe clipped, are left out.
constexpr int kGainStep = 8;  // px
constexpr int kLeastGainSamples = 100;
constexpr int kDark = 8;
constexpr int kBright = 247;
constexpr double kLargestGain = 4.0;

int tileOf(double coordinate) {
  return static_cast<int>(std::floor(coordinate / TileMap::kTileSize));
}

/// Bounds of the frame in the map, whole px.
cv::Rect boundsOf(const cv::Size& size, const Eigen::Matrix3d& to_map) {
  Eigen::AlignedBox2d box;
  for (const Eigen::Vector2d& corner : homography::imageCorners(size, {})) {
    box.extend(Eigen::Vector2d((to_map * corner.homogeneous()).hnormalized()));
  }
  const Eigen::Vector2d low = box.min().array().floor();
  const Eigen::Vector2d high = box.max().array().ceil() + 1.0;
  return {cv::Point(static_cast<int>(low.x()), static_cast<int>(low.y())),
          cv::Point(static_cast<int>(high.x()), static_cast<int>(high.y()))};
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
  for (int y = kGainStep / 2; y < frame.rows; y += kGainStep) {
    for (int x = kGainStep / 2; x < frame.cols; x += kGainStep) {
      const auto& pixel = frame.at<cv::Vec3b>(y, x);
      const cv::Vec3b* drawn = at((to_map * Eigen::Vector3d(x, y, 1.0)).hnormalized());
      if (drawn == nullptr || !isExposed(pixel) || !isExposed(*drawn)) continue;
      of_map += sumOf(*drawn);
      of_frame += sumOf(pixel);
      ++samples;
    }
  }
  if (samples < kLeastGainSamples) return 1.0;
  return std::clamp(of_map / of_frame, 1.0 / kLargestGain, kLargestGain);
}

bool TileMap::draw(const cv::Mat& frame, const Eigen::Matrix3d& to_map) {
  setFeather(frame.size());
  const cv::Rect bounds = boundsOf(frame.size(), to_map);
  bool all = true;
  for (int row = tileOf(bounds.y); row <= tileOf(bounds.br().y - 1); ++row) {
    for (int column = tileOf(bounds.x); column <= tileOf(bounds.br().x - 1); ++column) {
      all = drawTile({column, row}, frame, to_map) && all;
    }
  }
  return all;
}

bool TileMap::drawTile(const Place& place, const cv::Mat& frame, const Eigen::Matrix3d& to_map) {
  const cv::Rect region(place.first * kTileSize, place.second * kTileSize, kTileSize, kTileSize);
  Eigen::Matrix3d to_tile = Eigen::Matrix3d::Identity();
  to_tile(0, 2) = -region.x;
  to_tile(1, 2) = -region.y;
  cv::Mat homography;
  cv::eigen2cv(Eigen::Matrix3d(to_tile * to_map), homography);
  cv::warpPerspective(feather_, patch_weight_, homography, region.size(), cv::INTER_LINEAR);
  const cv::Rect covered = cv::boundingRect(patch_weight_);
  if (covered.empty()) return true;
  auto found = tiles_.find(place);
  if (found == tiles_.end()) {
    if (tiles_.size() >= max_tiles_) return false;
    found = tiles_
                .emplace(place, Tile{cv::Mat::zeros(region.size(), CV_8UC3),
                                     cv::Mat::zeros(region.size(), CV_16UC1)})
                .first;
  }
  // Repeats the last pixels beyond the border of the frame, because black would darken the rim.
  cv::warpPerspective(frame, patch_, homography, region.size(), cv::INTER_LINEAR,
                      cv::BORDER_REPLICATE);
  Tile& tile = found->second;
  for (int y = covered.y; y < covered.br().y; ++y) {
    blendRow(patch_.ptr<std::uint8_t>(y), patch_weight_.ptr<std::uint8_t>(y), kTileSize,
             tile.colour.ptr<std::uint8_t>(y), tile.weight.ptr<std::uint16_t>(y));
  }
  const cv::Rect drawn = covered + region.tl();
  area_ = area_.empty() ? drawn : area_ | drawn;
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
}

}  // namespace ktgp_orb::mosaic
