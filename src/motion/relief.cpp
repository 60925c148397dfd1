#include "motion/relief.h"

#include <cmath>

namespace ktgp_orb::motion {
namespace {

// The fit of a plane takes most of the relief with it. The seen plane is off by about twice what is
// left, and over half a picture, a third of the height, that is its slope.
constexpr double kOfPlane = 2.0;
constexpr double kOfSlope = 6.0;  // rad

}  // namespace

void Relief::add(double deviation, double parallax) {
  constexpr double kPictures = 30.0;
  constexpr double kLeastParallax = 0.05;  // with less nothing of the relief shows
  if (parallax < kLeastParallax) return;
  share_ += ((deviation > 0.0 ? 1.0 : 0.0) - share_) / kPictures;
  size_ += (deviation / parallax - size_) / kPictures;
}

bool Relief::isSeen() const {
  return share_ > 0.9;
}

HeightReading Relief::widened(HeightReading reading) const {
  if (isSeen())
    reading.deviation = std::hypot(reading.deviation, kOfPlane * size_ * reading.metres);
  return reading;
}

DownReading Relief::widened(DownReading reading) const {
  if (isSeen()) reading.deviation = std::hypot(reading.deviation, kOfSlope * size_);
  return reading;
}

}  // namespace ktgp_orb::motion
