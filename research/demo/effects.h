#pragma once

#include <cstdint>
#include <opencv2/core.hpp>

#include "demo/flight.h"

namespace ktgp_orb::demo {

constexpr double kFrameRate = 30.0;  ///< 1/s

/// Difficulty of a part of the flight, as in the paper's hard scenes.
enum class Segment { clean, lighting, blur, noise };

/// Half of the flight is clean; then a sixth each has changing light, motion blur and noise.
Segment segmentOf(int frame, int frames);
const char* toString(Segment segment);

/// Frame `frame` of the flight as the camera sends it, 8-bit BGR. The truth is the homography in
/// the middle of the exposure.
cv::Mat takePicture(const cv::Mat& map, int frame, int frames, std::uint64_t seed,
                    const Manner& manner = {});

/// Applies changing brightness and contrast, flicker, and a passing shadow at `t` s; 8 bit.
void changeLight(double t, cv::Mat& image);
/// Adds read noise of a few grey values, and shot noise that grows with the light; 8 bit.
void addNoise(std::uint64_t seed, cv::Mat& image);

}  // namespace ktgp_orb::demo
