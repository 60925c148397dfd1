#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "demo/canvas.h"

namespace ktgp_orb::demo {

/// The whole map in painting order: the ground, its shadows, and the objects on it.
struct Landscape {
  std::vector<Shape> ground;
  std::vector<Shape> shadows;  ///< colour is not used
  std::vector<Shape> objects;
};

/// Random numbers of the map, from one seed.
class Dice {
 public:
  explicit Dice(std::uint64_t seed) : rng_(seed) {}

  float between(float low, float high) { return rng_.uniform(low, high); }
  int pick(int count) { return rng_.uniform(0, count); }  ///< 0 .. count - 1
  bool chance(float probability) { return rng_.uniform(0.F, 1.F) < probability; }
  /// `colour` made darker or lighter by up to `amount` grey values.
  cv::Scalar shade(const cv::Scalar& colour, float amount);
  cv::Point2f inside(const Polygon& polygon);  ///< a random point of the convex polygon

 private:
  cv::RNG rng_;
};

/// Each function fills the convex polygon `block` with one use of land, and nothing outside it
/// except shadows.
void addTown(const Polygon& block, Dice& dice, Landscape& landscape);
void addField(const Polygon& block, Dice& dice, Landscape& landscape);
void addForest(const Polygon& block, Dice& dice, Landscape& landscape);
void addPark(const Polygon& block, Dice& dice, Landscape& landscape);
void addIndustry(const Polygon& block, Dice& dice, Landscape& landscape);

void addCar(cv::Point2f middle, cv::Point2f along, Dice& dice, Landscape& landscape);

}  // namespace ktgp_orb::demo
