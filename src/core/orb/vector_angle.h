#pragma once

namespace ktgp_orb::orb {

/// Angle of the vector (x, y) in degrees in [0, 360], to about 0.01; 0 for the null vector.
///
/// The polynomial of cv::fastAtan2; equal to it, bit for bit, on x86-64. OpenCV's own result
/// depends on the compiler: GCC for arm64 fuses multiplications with additions, and four angles in
/// a hundred differ in the last bit.
float vectorAngle(float y, float x);

}  // namespace ktgp_orb::orb
