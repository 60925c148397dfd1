#pragma once

namespace ktgp_orb::orb {

/// Angle of the vector (x, y) in degrees in [0, 360], to about 0.01; 0 for the null vector.
///
/// The polynomial of cv::fastAtan2, with which it agrees bit for bit on x86-64. It stands here
/// since OpenCV's own depends on the compiler: built for arm64 by GCC it fuses multiplications with
/// additions, and four angles in a hundred come out one unit in the last place away.
float vectorAngle(float y, float x);

}  // namespace ktgp_orb::orb
