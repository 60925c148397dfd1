// The pixel loops of ORB in plain C++, the reference for the vector versions.
#include "features/orb/kernels.h"

#include <algorithm>
#include <cmath>

#include "features/orb/kernels_common.h"
#include "features/orb/pattern.h"
#include "features/orb/teblid_kernel.h"

namespace ktgp_orb::orb {
namespace {

void resizeRow(const std::uint8_t* row, const ResizeBlock* blocks, int count, std::uint16_t* out) {
  for (const ResizeBlock* block = blocks; block != blocks + count; ++block) {
    for (int i = 0; i < kResizeBlock; ++i) {
      const int left = row[block->start + block->taps[i]];
      const int right = row[block->start + block->taps[kResizeBlock + i]];
      *out++ = static_cast<std::uint16_t>(block->weights[i] * left +
                                          block->weights[kResizeBlock + i] * right);
    }
  }
}

void mixRows(const std::uint16_t* above, const std::uint16_t* below, int weight, int count,
             std::uint8_t* out) {
  for (int x = 0; x < count; ++x) {
    const int sum = (256 - weight) * above[x] + weight * below[x];
    out[x] = static_cast<std::uint8_t>((sum + (1 << 15)) >> 16);
  }
}

// Returns the largest value such that all nine points of the arc from `start` on are darker, or all
// are brighter, than the centre by more than this value.
int arcContrast(const int (&difference)[16], int start) {
  int darker = 255;
  int brighter = 255;
  for (int i = 0; i < 9; ++i) {
    const int d = difference[(start + i) % 16];
    darker = std::min(darker, d);
    brighter = std::min(brighter, -d);
  }
  return std::max(darker, brighter) - 1;
}

void fastScores(const std::uint8_t* pixel, std::ptrdiff_t stride, int count, int threshold,
                std::uint8_t* scores) {
  for (int x = 0; x < count; ++x, ++pixel) {
    int difference[16];
    for (int i = 0; i < 16; ++i) {
      difference[i] = *pixel - pixel[kFastCircleY[i] * stride + kFastCircleX[i]];
    }
    int score = 0;
    for (int start = 0; start < 16; ++start) {
      score = std::max(score, arcContrast(difference, start));
    }
    scores[x] = static_cast<std::uint8_t>(score >= threshold ? score : 0);
  }
}

int localMaxima(const std::uint8_t* above, const std::uint8_t* row, const std::uint8_t* below,
                int count, std::int32_t* maxima) {
  int found = 0;
  for (int x = 0; x < count; ++x) {
    const int highest = std::max({above[x - 1], above[x], above[x + 1], row[x - 1], row[x + 1],
                                  below[x - 1], below[x], below[x + 1]});
    if (row[x] > highest) maxima[found++] = x;
  }
  return found;
}

float harris(const std::uint8_t* pixel, std::ptrdiff_t stride) {
  int xx = 0;
  int yy = 0;
  int xy = 0;
  for (int y = -kHarrisRadius; y <= kHarrisRadius; ++y) {
    for (int x = -kHarrisRadius; x <= kHarrisRadius; ++x) {
      const std::uint8_t* mid = pixel + y * stride + x;
      const std::uint8_t* up = mid - stride;
      const std::uint8_t* down = mid + stride;
      const int dx = 2 * (mid[1] - mid[-1]) + (up[1] - up[-1]) + (down[1] - down[-1]);
      const int dy = 2 * (down[0] - up[0]) + (down[-1] - up[-1]) + (down[1] - up[1]);
      xx += dx * dx;
      yy += dy * dy;
      xy += dx * dy;
    }
  }
  return harrisResponse(xx, yy, xy);
}

std::pair<int, int> moments(const std::uint8_t* pixel, std::ptrdiff_t stride) {
  int sum_x = 0;
  int sum_y = 0;
  for (int y = -kOrientationRadius; y <= kOrientationRadius; ++y) {
    const int half_width = kDiscHalfWidth[std::abs(y)];
    for (int x = -half_width; x <= half_width; ++x) {
      const int value = pixel[y * stride + x];
      sum_x += x * value;
      sum_y += y * value;
    }
  }
  return {sum_x, sum_y};
}

// Computes a * b + c with one rounding, like a fused multiply-add, since the product of two floats
// is exact in double precision. (The sum is rounded twice, to double and then to float. The result
// can differ only if the sum in double precision is exactly half-way between two floats.)
float multiplyAdd(float a, float b, float c) {
  return static_cast<float>(static_cast<double>(a) * b + c);
}

void blurAlongRow(const std::uint8_t* pixel, int count, float* out) {
  for (int x = 0; x < count; ++x) {
    float sum = 0.f;
    for (int i = -kBlurRadius; i <= kBlurRadius; ++i) {
      sum = multiplyAdd(kGaussian[std::abs(i)], pixel[x + i], sum);
    }
    out[x] = sum;
  }
}

void blurAcrossRows(const float* const* rows, int count, std::uint8_t* out) {
  const float* const* middle = rows + kBlurRadius;
  for (int x = 0; x < count; ++x) {
    float sum = kGaussian[0] * middle[0][x];
    for (int i = 1; i <= kBlurRadius; ++i) {
      sum = multiplyAdd(kGaussian[i], middle[i][x] + middle[-i][x], sum);
    }
    out[x] = static_cast<std::uint8_t>(std::lrint(sum));
  }
}

void describe(const std::uint8_t* pixel, std::ptrdiff_t stride, float cosine, float sine,
              std::uint8_t* descriptor) {
  const auto sample = [&](float x, float y) {
    const long column = std::lrint(x * cosine - y * sine);
    const long row = std::lrint(x * sine + y * cosine);
    return pixel[row * stride + column];
  };
  std::fill_n(descriptor, kPatternPairs / 8, std::uint8_t{0});
  for (int i = 0; i < kPatternPairs; ++i) {
    const bool darker = sample(kPatternX[i], kPatternY[i]) <
                        sample(kPatternX[kPatternPairs + i], kPatternY[kPatternPairs + i]);
    if (darker) descriptor[i / 8] |= static_cast<std::uint8_t>(1 << (i % 8));
  }
}

void describeTeblidInside(const std::uint32_t* integral, const TeblidScale& scale,
                          const TeblidPlacement& p, std::uint8_t* descriptor) {
  std::int32_t centres[2 * kTeblidBits];
  std::int32_t differences[kTeblidBits];
  for (int i = 0; i < 2 * kTeblidBits; ++i) {
    const float u = kTeblidOrder.u[i];
    const float v = kTeblidOrder.v[i];
    const int x = static_cast<int>(p.x_from_u * u + p.x_from_v * v + p.x + kTeblidHalf);
    const int y = static_cast<int>(p.y_from_u * u + p.y_from_v * v + p.y + kTeblidHalf);
    centres[i] = y * scale.stride + x;
  }
  compareBoxes(integral, scale, centres, differences);
  for (int byte = 0; byte < kTeblidBits / 8; ++byte) {
    unsigned bits = 0;
    for (int i = 8 * byte + 7; i >= 8 * byte; --i) {
      bits = 2 * bits + static_cast<unsigned>(differences[i] < scale.bound[i]);
    }
    descriptor[byte] = static_cast<std::uint8_t>(bits);
  }
}

}  // namespace

const OrbKernels& portableOrbKernels() {
  static constexpr OrbKernels kPortable{
      "portable", resizeRow,    mixRows,        fastScores, localMaxima,         harris,
      moments,    blurAlongRow, blurAcrossRows, describe,   describeTeblidInside};
  return kPortable;
}

}  // namespace ktgp_orb::orb
