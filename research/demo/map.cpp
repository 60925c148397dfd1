#include "demo/map.h"

#include <algorithm>
#include <cmath>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "demo/landscape.h"
#include "util/constants.h"

namespace ktgp_orb::demo {
namespace {

constexpr double kLargestBlock = 200000.0;  // px², about 450 × 450
const cv::Scalar kAsphalt(92, 92, 94);
const cv::Scalar kPavement(160, 166, 170);
const cv::Scalar kLaneMark(215, 220, 220);

void addRoad(cv::Point2f middle, cv::Point2f along, const Polygon& within, Dice& dice,
             Landscape& landscape) {
  for (float s = -3000.F; s < 3000.F; s += 24.F) {
    const cv::Point2f at = middle + along * s;
    if (cv::pointPolygonTest(within, at, true) < 8.0) continue;
    landscape.ground.push_back({rectangle(at, {11.F, 1.8F}, along), 0.F, kLaneMark});
    if (dice.chance(0.12F)) {
      const cv::Point2f lane = cv::Point2f(-along.y, along.x) * (dice.chance(0.5F) ? 9.F : -9.F);
      addCar(at + lane, along, dice, landscape);
    }
    if (dice.chance(0.25F)) {  // a patch in the asphalt
      const cv::Point2f patch = at + cv::Point2f(-along.y, along.x) * dice.between(-12.F, 12.F);
      landscape.ground.push_back(
          {rectangle(patch, {dice.between(4.F, 22.F), dice.between(3.F, 8.F)}, along), 0.F,
           dice.shade(kAsphalt, 30.F)});
    }
  }
}

void addBlock(const Polygon& block, Dice& dice, Landscape& landscape) {
  landscape.ground.push_back({block, 0.F, dice.shade(kPavement, 10.F)});
  const Polygon land = shrink(block, 6.F);
  if (area(land) < 4000.0) return;
  const float use = dice.between(0.F, 1.F);
  if (use < 0.46F) {
    addTown(land, dice, landscape);
  } else if (use < 0.62F) {
    addField(land, dice, landscape);
  } else if (use < 0.74F) {
    addForest(land, dice, landscape);
  } else if (use < 0.84F) {
    addPark(land, dice, landscape);
  } else {
    addIndustry(land, dice, landscape);
  }
}

/// Divides the land by roads, across its longer extent, until the blocks are small enough.
void settle(const Polygon& land, Dice& dice, Landscape& landscape) {
  if (area(land) < kLargestBlock) {
    addBlock(land, dice, landscape);
    return;
  }
  const cv::RotatedRect box = cv::minAreaRect(land);
  const float turn = box.size.width > box.size.height ? 0.F : 90.F;
  const double angle = (box.angle + turn + dice.between(-9.F, 9.F)) * util::kPi / 180.0;
  const cv::Point2f across(static_cast<float>(std::cos(angle)),
                           static_cast<float>(std::sin(angle)));
  const cv::Point2f along(-across.y, across.x);
  const float extent = std::max(box.size.width, box.size.height);
  const cv::Point2f at = centre(land) + across * (dice.between(-0.12F, 0.12F) * extent);
  const float half_width = area(land) > 8.0 * kLargestBlock ? 20.F : 17.F;
  addRoad(at, along, land, dice, landscape);
  settle(cut(land, at + across * half_width, across), dice, landscape);
  settle(cut(land, at - across * half_width, -across), dice, landscape);
}

Landscape makeLandscape(std::uint64_t seed) {
  Dice dice(seed);
  Landscape landscape;
  const float margin = 200.F;
  const float end = kMapSize + margin;
  settle({{-margin, -margin}, {end, -margin}, {end, end}, {-margin, end}}, dice, landscape);
  return landscape;
}

/// Brightness that varies at every scale from one to 256 px: mean 1.
cv::Mat makeTexture(std::uint64_t seed) {
  // Size in px, and deviation relative to the brightness.
  constexpr std::pair<int, float> kOctaves[] = {{1, 0.055F}, {2, 0.06F},  {4, 0.045F},
                                                {16, 0.03F}, {64, 0.04F}, {256, 0.06F}};
  cv::RNG rng(seed);
  cv::Mat texture(kMapSize, kMapSize, CV_32F, cv::Scalar(1.0));
  cv::Mat coarse;
  cv::Mat fine;
  for (const auto& [size, deviation] : kOctaves) {
    coarse.create(kMapSize / size, kMapSize / size, CV_32F);
    rng.fill(coarse, cv::RNG::NORMAL, 0.0, deviation);
    cv::resize(coarse, fine, texture.size(), 0, 0, cv::INTER_LINEAR);
    texture += fine;
  }
  return texture;
}

/// Multiplies the image by texture · (1 - shadow/255), in place.
void shade(const cv::Mat& texture, const cv::Mat& shadow, cv::Mat& image) {
  cv::parallel_for_(cv::Range(0, image.rows), [&](const cv::Range& range) {
    for (int y = range.start; y < range.end; ++y) {
      const auto* factor = texture.ptr<float>(y);
      const auto* dark = shadow.empty() ? nullptr : shadow.ptr<std::uint8_t>(y);
      auto* pixel = image.ptr<cv::Vec3b>(y);
      for (int x = 0; x < image.cols; ++x) {
        const float light = factor[x] * (dark == nullptr ? 1.F : 1.F - dark[x] / 255.F);
        for (int c = 0; c < 3; ++c)
          pixel[x][c] = cv::saturate_cast<std::uint8_t>(pixel[x][c] * light);
      }
    }
  });
}

}  // namespace

cv::Mat drawMap(std::uint64_t seed) {
  const Landscape landscape = makeLandscape(seed);
  cv::Mat map(kMapSize, kMapSize, CV_8UC3, kAsphalt);
  paint(landscape.ground, map);

  constexpr double kShadowStrength = 0.5 * 255.0;
  cv::Mat shadow(map.size(), CV_8U, cv::Scalar(0));
  std::vector<Shape> shadows = landscape.shadows;
  for (Shape& shape : shadows) shape.colour = cv::Scalar(kShadowStrength);
  paint(shadows, shadow);
  const cv::Mat flat(map.size(), CV_32F, cv::Scalar(1.0));
  shade(flat, shadow, map);

  paint(landscape.objects, map);
  shade(makeTexture(seed + 1), {}, map);
  return map;
}

}  // namespace ktgp_orb::demo
