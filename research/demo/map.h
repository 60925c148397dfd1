#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

namespace ktgp_orb::demo {

constexpr int kMapSize = 4096;  ///< width and height of the map, px of about 20 cm

/// Draws an aerial picture of an invented landscape: streets, houses, halls, car parks, fields,
/// woods and parks. It has details from one pixel to hundreds of pixels, so that there are corners
/// everywhere at every height of flight. 8-bit BGR, kMapSize square; the same seed gives the same
/// picture.
cv::Mat drawMap(std::uint64_t seed);

}  // namespace ktgp_orb::demo
