#include "features/alignment/kernels.h"

namespace ktgp_orb::alignment {
namespace {

/// Sixteen sums, one for each column. With this order of additions, vectors of any width give the
/// same result.
class ColumnSums {
 public:
  void add(int column, float value) { sums_[column] += value; }
  float total() const { return sumOfColumns(sums_); }

 private:
  float sums_[kPatchSide] = {};
};

void warp(const std::uint8_t* pixel, std::ptrdiff_t stride, const AffineWalk& walk, float* patch) {
  constexpr float kScale = 1.F / 65536.F;
  for (int row = 0; row < kWarpSide; ++row) {
    for (int column = 0; column < kWarpPitch; ++column) {
      const std::int32_t x = walk.x0 + row * walk.x_row + column * walk.x_column;
      const std::int32_t y = walk.y0 + row * walk.y_row + column * walk.y_column;
      const std::uint8_t* p = pixel + (y >> 16) * stride + (x >> 16);
      const std::int32_t fx = (x >> 8) & 255;
      const std::int32_t fy = (y >> 8) & 255;
      const std::int32_t above = (256 - fx) * p[0] + fx * p[1];
      const std::int32_t below = (256 - fx) * p[stride] + fx * p[stride + 1];
      patch[row * kWarpPitch + column] =
          static_cast<float>((256 - fy) * above + fy * below) * kScale;
    }
  }
}

float smoothed(float a, float b, float c, float d, float e) {
  return ((a + e) + 4.F * (b + d) + 6.F * c) * (1.F / 16.F);
}

float derived(float a, float b, float d, float e) {
  return ((e - a) + 2.F * (d - b)) * (1.F / 8.F);
}

using Rows = float[kPatchSide][kPatchSide];

void removeMean(Rows& rows) {
  ColumnSums sums;
  for (const auto& row : rows) {
    for (int c = 0; c < kPatchSide; ++c) sums.add(c, row[c]);
  }
  const float mean = sums.total() * (1.F / (kPatchSide * kPatchSide));
  for (auto& row : rows) {
    for (float& value : row) value -= mean;
  }
}

float product(const Rows& a, const Rows& b) {
  ColumnSums sums;
  for (int r = 0; r < kPatchSide; ++r) {
    for (int c = 0; c < kPatchSide; ++c) sums.add(c, a[r][c] * b[r][c]);
  }
  return sums.total();
}

void prepare(const float* patch, PatchTemplate& out) {
  for (int r = 0; r < kPatchSide; ++r) {
    float smooth[kWarpPitch];
    float slope[kWarpPitch];
    for (int c = 0; c < kWarpPitch; ++c) {
      const float* p = patch + r * kWarpPitch + c;
      smooth[c] =
          smoothed(p[0], p[kWarpPitch], p[2 * kWarpPitch], p[3 * kWarpPitch], p[4 * kWarpPitch]);
      slope[c] = derived(p[0], p[kWarpPitch], p[3 * kWarpPitch], p[4 * kWarpPitch]);
    }
    for (int c = 0; c < kPatchSide; ++c) {
      const float* s = smooth + c;
      const float* d = slope + c;
      out.value[r][c] = smoothed(s[0], s[1], s[2], s[3], s[4]);
      out.dx[r][c] = derived(s[0], s[1], s[3], s[4]);
      out.dy[r][c] = smoothed(d[0], d[1], d[2], d[3], d[4]);
    }
  }
  removeMean(out.value);
  removeMean(out.dx);
  removeMean(out.dy);
  out.tt = product(out.value, out.value);
  out.tx = product(out.value, out.dx);
  out.ty = product(out.value, out.dy);
  out.xx = product(out.dx, out.dx);
  out.xy = product(out.dx, out.dy);
  out.yy = product(out.dy, out.dy);
}

/// The weights 1 4 6 4 1 across and down give 256 times the smoothed value, which fits into sixteen
/// bits.
void smooth(const std::uint8_t* pixel, std::ptrdiff_t stride, float* window) {
  const auto across = [&](int row, int column) {
    const std::uint8_t* p = pixel + row * stride + column;
    return p[0] + p[4] + 4 * (p[1] + p[3]) + 6 * p[2];
  };
  for (int row = 0; row < kWindowSide; ++row) {
    for (int column = 0; column < kWindowSide; ++column) {
      const int sum = across(row, column) + across(row + 4, column) +
                      4 * (across(row + 1, column) + across(row + 3, column)) +
                      6 * across(row + 2, column);
      window[row * kWindowPitch + column] = static_cast<float>(sum) * (1.F / 256.F);
    }
  }
}

float mixed(const CubicWeights& w, float before, float at, float behind, float last) {
  return (w.before * before + w.at * at) + (w.behind * behind + w.last * last);
}

MatchSums compare(const float* corner, float fx, float fy, const PatchTemplate& patch) {
  const CubicWeights x(fx);
  const CubicWeights y(fy);
  const auto across = [&](int row, int column) {
    const float* p = corner + row * kWindowPitch + column;
    return mixed(x, p[-1], p[0], p[1], p[2]);
  };
  ColumnSums i, ii, ti, xi, yi;
  for (int row = 0; row < kPatchSide; ++row) {
    for (int column = 0; column < kPatchSide; ++column) {
      const float value = mixed(y, across(row - 1, column), across(row, column),
                                across(row + 1, column), across(row + 2, column));
      i.add(column, value);
      ii.add(column, value * value);
      ti.add(column, value * patch.value[row][column]);
      xi.add(column, value * patch.dx[row][column]);
      yi.add(column, value * patch.dy[row][column]);
    }
  }
  return {i.total(), ii.total(), ti.total(), xi.total(), yi.total()};
}

}  // namespace

const AlignmentKernels& portableAlignmentKernels() {
  static const AlignmentKernels portable{"portable", warp, prepare, smooth, compare};
  return portable;
}

}  // namespace ktgp_orb::alignment
