#include "demo/landscape.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace ktgp_orb::demo {
namespace {

// Lengths are map pixels of about 20 cm.
const cv::Point2f kSun(0.55F, 0.75F);  // shift of a shadow per height
const cv::Scalar kGrass(70, 120, 95);
const cv::Scalar kLeaves(45, 85, 55);
const cv::Scalar kConcrete(165, 172, 176);
const cv::Scalar kAsphalt(98, 98, 100);
const cv::Scalar kWhite(225, 228, 228);

cv::Scalar lighter(const cv::Scalar& colour, double factor) {
  return colour * factor;
}

cv::Point2f normalTo(cv::Point2f along) {
  return {-along.y, along.x};
}

/// Unit vector along the longest side.
cv::Point2f longestSide(const Polygon& polygon) {
  cv::Point2f longest(1.F, 0.F);
  double best = 0.0;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const cv::Point2f side = polygon[(i + 1) % polygon.size()] - polygon[i];
    if (cv::norm(side) > best) {
      best = cv::norm(side);
      longest = side / static_cast<float>(best);
    }
  }
  return longest;
}

void addShadow(const Polygon& outline, float height, Landscape& landscape) {
  Polygon both = outline;
  for (const cv::Point2f& corner : outline) both.push_back(corner + kSun * height);
  Polygon hull;
  cv::convexHull(both, hull);
  landscape.shadows.push_back({hull, 0.F, {}});
}

void addTree(cv::Point2f middle, float radius, Dice& dice, Landscape& landscape) {
  landscape.shadows.push_back({{middle + kSun * radius * 0.9F}, radius, {}});
  cv::Scalar leaves = dice.shade(kLeaves, 22.F);
  leaves[2] += dice.between(-12.F, 30.F);
  landscape.objects.push_back({{middle}, radius, lighter(leaves, 0.62)});
  // Branches: darker on the side away from the sun.
  const int boughs = 5 + static_cast<int>(radius / 2.F);
  for (int i = 0; i < boughs; ++i) {
    const float angle = dice.between(0.F, 6.283F);
    const float distance = dice.between(0.F, 0.72F) * radius;
    const cv::Point2f offset(distance * std::cos(angle), distance * std::sin(angle));
    const double light = 1.05 - 0.4 * (offset.dot(kSun) / radius) + dice.between(-0.25F, 0.35F);
    landscape.objects.push_back(
        {{middle + offset}, radius * dice.between(0.16F, 0.36F), lighter(leaves, light)});
  }
}

/// Covers `surface` with thin lines parallel to `along`, `spacing` px apart.
void addStripes(const Polygon& surface, cv::Point2f along, float spacing, float width,
                const cv::Scalar& colour, float variation, Dice& dice, std::vector<Shape>& layer) {
  const cv::Point2f across = normalTo(along);
  const cv::Point2f middle = centre(surface);
  float reach = 0.F;
  for (const cv::Point2f& corner : surface) {
    reach = std::max(reach, static_cast<float>(cv::norm(corner - middle)));
  }
  for (float offset = -reach; offset < reach; offset += spacing) {
    const Polygon line = rectangle(middle + across * offset, {2.F * reach, width}, along);
    layer.push_back({intersect(line, surface), 0.F, dice.shade(colour, variation)});
  }
}

void addBox(const Polygon& outline, float height, const cv::Scalar& colour, Landscape& landscape) {
  addShadow(outline, height, landscape);
  landscape.objects.push_back({outline, 0.F, colour});
}

/// Adds an object on a roof, with a shadow: the roof hides the layer of shadows on the ground.
void addRoofBox(const Polygon& outline, float height, const cv::Scalar& roof,
                const cv::Scalar& colour, Landscape& landscape) {
  landscape.objects.push_back({shifted(outline, kSun * height), 0.F, lighter(roof, 0.5)});
  landscape.objects.push_back({outline, 0.F, colour});
}

void addGableRoof(cv::Point2f middle, cv::Size2f size, cv::Point2f along, Dice& dice,
                  Landscape& landscape) {
  static const cv::Scalar tile_colours[] = {{62, 78, 168}, {70, 92, 150},   {84, 86, 92},
                                            {58, 62, 110}, {110, 116, 122}, {75, 105, 165}};
  const cv::Scalar tiles = dice.shade(tile_colours[dice.pick(6)], 18.F);
  const cv::Point2f across = normalTo(along);
  const float side = across.dot(kSun) > 0.F ? 1.F : -1.F;
  addShadow(rectangle(middle, size, along), dice.between(14.F, 24.F), landscape);
  for (const float half : {-side, side}) {
    const Polygon face = rectangle(middle + across * (half * size.height / 4.F),
                                   {size.width, size.height / 2.F}, along);
    const cv::Scalar colour = lighter(tiles, half == side ? 0.68 : 1.12);
    landscape.objects.push_back({face, 0.F, colour});
    addStripes(face, along, 4.5F, 1.2F, lighter(colour, 0.8), 10.F, dice, landscape.objects);
    if (dice.chance(0.5F)) {  // solar panels or a roof window
      const bool panels = dice.chance(0.4F);
      const cv::Size2f window = panels ? cv::Size2f(20.F, 10.F) : cv::Size2f(6.F, 5.F);
      const cv::Point2f at = centre(face) + along * dice.between(-0.25F, 0.25F) * size.width;
      landscape.objects.push_back(
          {rectangle(at, window, along), 0.F, panels ? cv::Scalar(70, 45, 35) : kWhite});
    }
  }
  landscape.objects.push_back(
      {rectangle(middle, {size.width, 1.6F}, along), 0.F, lighter(tiles, 1.35)});
  const cv::Point2f chimney = middle + along * (dice.between(-0.35F, 0.35F) * size.width);
  addRoofBox(rectangle(chimney, {5.F, 5.F}, along), 7.F, tiles, {90, 95, 130}, landscape);
}

void addLot(const Polygon& lot, Dice& dice, Landscape& landscape) {
  landscape.ground.push_back({lot, 0.F, dice.shade(kGrass, 25.F)});
  const cv::Point2f along = longestSide(lot);
  const cv::Point2f across = normalTo(along);
  const cv::Point2f middle = centre(lot);
  const float width = dice.between(38.F, 60.F);
  const float depth = dice.between(32.F, 44.F);
  const Polygon drive = rectangle(middle + along * (width * 0.4F), {14.F, 200.F}, along);
  landscape.ground.push_back({intersect(drive, lot), 0.F, dice.shade(kConcrete, 20.F)});
  const Polygon terrace = rectangle(middle + across * (depth * 0.7F), {width * 0.6F, 16.F}, along);
  landscape.ground.push_back({intersect(terrace, lot), 0.F, dice.shade({140, 155, 175}, 20.F)});
  const Polygon garden = shrink(lot, 9.F);
  for (int i = 0; i < 14 && !garden.empty(); ++i) {  // bushes, flower beds, objects
    const cv::Scalar colour =
        dice.chance(0.7F) ? dice.shade(kLeaves, 30.F) : dice.shade({150, 150, 170}, 60.F);
    landscape.ground.push_back({{dice.inside(garden)}, dice.between(1.5F, 4.F), colour});
  }
  if (dice.chance(0.15F) && !garden.empty()) {
    const Polygon pool = rectangle(dice.inside(garden), {24.F, 13.F}, along);
    landscape.ground.push_back({intersect(pool, garden), 0.F, {205, 185, 90}});
  }
  addGableRoof(middle, {width, depth}, along, dice, landscape);
  if (dice.chance(0.6F))
    addCar(middle + along * (width * 0.4F) + across * 34.F, across, dice, landscape);
  for (int i = dice.pick(4); i > 0 && !garden.empty(); --i) {
    addTree(dice.inside(garden), dice.between(6.F, 12.F), dice, landscape);
  }
}

void addParking(const Polygon& place, Dice& dice, Landscape& landscape) {
  const cv::Point2f along = longestSide(place);
  const cv::Point2f across = normalTo(along);
  const cv::Point2f middle = centre(place);
  for (float row = -150.F; row <= 150.F; row += 46.F) {
    for (float bay = -240.F; bay <= 240.F; bay += 13.F) {
      const cv::Point2f at = middle + across * row + along * bay;
      if (cv::pointPolygonTest(place, at, true) < 16.0) continue;
      const cv::Point2f line = at + along * 6.5F;
      landscape.ground.push_back({rectangle(line, {1.2F, 24.F}, along), 0.F, kWhite});
      if (dice.chance(0.6F)) addCar(at, across, dice, landscape);
    }
  }
}

void addHall(const Polygon& plot, Dice& dice, Landscape& landscape) {
  static const cv::Scalar roof_colours[] = {
      {190, 190, 188}, {150, 140, 128}, {165, 172, 180}, {140, 120, 95}, {120, 128, 150}};
  const cv::Scalar roof = dice.shade(roof_colours[dice.pick(5)], 15.F);
  const Polygon outline = shrink(plot, 14.F);
  if (area(outline) < 2500.0) return;
  const cv::Point2f along = longestSide(outline);
  addBox(outline, dice.between(22.F, 34.F), lighter(roof, 0.8), landscape);
  const Polygon deck = shrink(outline, 3.F);
  landscape.objects.push_back({deck, 0.F, roof});
  addStripes(deck, normalTo(along), 14.F, 1.4F, lighter(roof, 0.85), 12.F, dice, landscape.objects);
  const Polygon inner = shrink(deck, 8.F);
  if (inner.empty()) return;
  for (int i = static_cast<int>(area(inner) / 700.0); i > 0; --i) {
    const cv::Size2f size(dice.between(4.F, 16.F), dice.between(4.F, 9.F));
    const Polygon unit = rectangle(dice.inside(inner), size, along);
    addRoofBox(unit, dice.between(3.F, 8.F), roof, dice.shade({170, 170, 170}, 70.F), landscape);
  }
}

/// Divides the convex polygon across its longest side until every part is below `largest` px².
void splitInto(const Polygon& polygon, double largest, Dice& dice, std::vector<Polygon>& parts) {
  if (area(polygon) < largest) {
    if (area(polygon) > largest / 8.0) parts.push_back(polygon);
    return;
  }
  const cv::Point2f along = longestSide(polygon);
  const cv::Point2f at = centre(polygon) + along * dice.between(-8.F, 8.F);
  splitInto(cut(polygon, at, along), largest, dice, parts);
  splitInto(cut(polygon, at, -along), largest, dice, parts);
}

}  // namespace

cv::Scalar Dice::shade(const cv::Scalar& colour, float amount) {
  return colour + cv::Scalar::all(between(-amount, amount));
}

cv::Point2f Dice::inside(const Polygon& polygon) {
  // Picks a random triangle of the fan around the first corner, then a random point in it.
  const int triangle = pick(std::max(1, static_cast<int>(polygon.size()) - 2));
  float u = between(0.F, 1.F);
  float v = between(0.F, 1.F);
  if (u + v > 1.F) u = 1.F - u, v = 1.F - v;
  const auto second = std::min(static_cast<std::size_t>(triangle + 1), polygon.size() - 1);
  const auto third = std::min(second + 1, polygon.size() - 1);
  return polygon[0] + (polygon[second] - polygon[0]) * u + (polygon[third] - polygon[0]) * v;
}

void addCar(cv::Point2f middle, cv::Point2f along, Dice& dice, Landscape& landscape) {
  static const cv::Scalar paint_colours[] = {{215, 215, 215}, {45, 45, 48},   {160, 160, 160},
                                             {45, 45, 170},   {150, 80, 40},  {90, 90, 95},
                                             {230, 230, 228}, {60, 110, 130}, {120, 60, 50}};
  const cv::Scalar paint = dice.shade(paint_colours[dice.pick(9)], 12.F);
  addBox(rectangle(middle, {21.F, 9.F}, along), 5.F, paint, landscape);
  landscape.objects.push_back(
      {rectangle(middle + along * 3.F, {4.F, 7.5F}, along), 0.F, {50, 45, 40}});
  landscape.objects.push_back(
      {rectangle(middle - along * 7.F, {2.5F, 7.F}, along), 0.F, {55, 50, 45}});
}

void addTown(const Polygon& block, Dice& dice, Landscape& landscape) {
  std::vector<Polygon> lots;
  splitInto(block, 14000.0, dice, lots);
  for (const Polygon& lot : lots) {
    landscape.ground.push_back({lot, 0.F, dice.shade(kLeaves, 12.F)});  // hedge
    addLot(shrink(lot, 2.5F), dice, landscape);
  }
}

void addField(const Polygon& block, Dice& dice, Landscape& landscape) {
  static const cv::Scalar crop_colours[] = {
      {75, 150, 135}, {95, 165, 190}, {60, 105, 75}, {85, 115, 145}, {90, 140, 110}};
  std::vector<Polygon> parts;
  splitInto(block, 120000.0, dice, parts);
  for (const Polygon& part : parts) {
    const cv::Scalar crop = dice.shade(crop_colours[dice.pick(5)], 15.F);
    landscape.ground.push_back({part, 0.F, lighter(crop, 0.8)});
    const Polygon sown = shrink(part, 4.F);
    addStripes(sown, longestSide(part), dice.between(7.F, 12.F), dice.between(3.F, 5.F), crop, 14.F,
               dice, landscape.ground);
    for (int i = static_cast<int>(area(sown) / 110.0); i > 0; --i) {  // tufts, stones, bare spots
      const double light = dice.chance(0.6F) ? dice.between(0.4F, 0.7F) : dice.between(1.2F, 1.5F);
      landscape.ground.push_back(
          {{dice.inside(sown)}, dice.between(1.F, 2.8F), lighter(crop, light)});
    }
  }
}

void addForest(const Polygon& block, Dice& dice, Landscape& landscape) {
  landscape.ground.push_back({block, 0.F, lighter(kLeaves, 0.7)});
  const cv::Rect box = cv::boundingRect(block);
  const Polygon inner = shrink(block, 8.F);
  if (inner.empty()) return;
  constexpr float kSpacing = 17.F;
  for (float y = 0.F; y < static_cast<float>(box.height); y += kSpacing) {
    for (float x = 0.F; x < static_cast<float>(box.width); x += kSpacing) {
      const cv::Point2f at(static_cast<float>(box.x) + x + dice.between(-8.F, 8.F),
                           static_cast<float>(box.y) + y + dice.between(-8.F, 8.F));
      const float radius = dice.between(7.F, 14.F);
      if (cv::pointPolygonTest(inner, at, false) > 0) addTree(at, radius, dice, landscape);
    }
  }
}

void addPark(const Polygon& block, Dice& dice, Landscape& landscape) {
  landscape.ground.push_back({block, 0.F, dice.shade(kGrass, 15.F)});
  const Polygon lawn = shrink(block, 10.F);
  if (lawn.empty()) return;
  for (int i = static_cast<int>(area(lawn) / 150.0); i > 0; --i) {
    landscape.ground.push_back(
        {{dice.inside(lawn)}, dice.between(1.F, 3.5F), dice.shade(kGrass, 55.F)});
  }
  for (int i = 0; i < 3; ++i) {
    const float angle = dice.between(0.F, 3.14F);
    const Polygon path =
        rectangle(dice.inside(lawn), {1500.F, 9.F}, {std::cos(angle), std::sin(angle)});
    landscape.ground.push_back({intersect(path, block), 0.F, dice.shade({140, 170, 190}, 15.F)});
  }
  for (int i = static_cast<int>(area(lawn) / 1600.0); i > 0; --i) {
    addTree(dice.inside(lawn), dice.between(6.F, 15.F), dice, landscape);
  }
}

void addIndustry(const Polygon& block, Dice& dice, Landscape& landscape) {
  landscape.ground.push_back({block, 0.F, dice.shade(kAsphalt, 15.F)});
  std::vector<Polygon> plots;
  splitInto(block, 60000.0, dice, plots);
  for (const Polygon& plot : plots) {
    if (dice.chance(0.35F)) {
      addParking(plot, dice, landscape);
    } else {
      addHall(plot, dice, landscape);
    }
  }
}

}  // namespace ktgp_orb::demo
