// Warping, smoothing and comparing patches. No include guard: dispatch.cpp includes this
// once for each instruction set.
#include <hwy/highway.h>

#include "features/alignment/kernels.h"

HWY_BEFORE_NAMESPACE();
namespace ktgp_orb::alignment {
namespace HWY_NAMESPACE {
namespace {

namespace hn = hwy::HWY_NAMESPACE;

// A row of a patch takes one vector with AVX-512, two vectors with AVX2, and four vectors
// otherwise.
const hn::CappedTag<float, kPatchSide> kFloats;
using Floats = hn::Vec<decltype(kFloats)>;
constexpr int kFloatLanes = static_cast<int>(hn::MaxLanes(kFloats));

// Every product and sum below is an integer below 2^24, which floats represent exactly.
void warp(const std::uint8_t* pixel, std::ptrdiff_t stride, const AffineWalk& walk, float* patch) {
  const hn::CappedTag<float, 8> df;
  const hn::RebindToSigned<decltype(df)> di;
  constexpr int kLanes = static_cast<int>(hn::MaxLanes(df));
  const auto* base = reinterpret_cast<const std::int32_t*>(pixel);
  const auto* below = reinterpret_cast<const std::int32_t*>(pixel + stride);
  const auto low_byte = hn::Set(di, 255);
  const auto one = hn::Set(df, 256.F);
  const auto scale = hn::Set(df, 1.F / 65536.F);
  const auto step = hn::Set(di, static_cast<std::int32_t>(stride));
  const auto first = [&](auto value) { return hn::ConvertTo(df, hn::And(value, low_byte)); };
  const auto second = [&](auto value) {
    return hn::ConvertTo(df, hn::And(hn::ShiftRight<8>(value), low_byte));
  };
  const auto mix = [&](auto a, auto b, auto weight) {
    return hn::Add(hn::Mul(hn::Sub(one, weight), a), hn::Mul(weight, b));
  };
  const auto lane = hn::Iota(di, 0);
  for (int column = 0; column < kWarpPitch; column += kLanes) {
    const auto number = hn::Add(lane, hn::Set(di, column));
    auto x = hn::Add(hn::Set(di, walk.x0), hn::Mul(number, hn::Set(di, walk.x_column)));
    auto y = hn::Add(hn::Set(di, walk.y0), hn::Mul(number, hn::Set(di, walk.y_column)));
    for (int row = 0; row < kWarpSide; ++row) {
      const auto offset = hn::Add(hn::Mul(hn::ShiftRight<16>(y), step), hn::ShiftRight<16>(x));
      const auto top = hn::GatherOffset(di, base, offset);
      const auto bottom = hn::GatherOffset(di, below, offset);
      const auto fx = second(x);
      const auto mixed =
          mix(mix(first(top), second(top), fx), mix(first(bottom), second(bottom), fx), second(y));
      hn::StoreU(hn::Mul(mixed, scale), df, patch + row * kWarpPitch + column);
      x = hn::Add(x, hn::Set(di, walk.x_row));
      y = hn::Add(y, hn::Set(di, walk.y_row));
    }
  }
}

template <typename V>
HWY_INLINE V smoothed(V a, V b, V c, V d, V e) {
  const hn::DFromV<V> tag;
  const V sum = hn::Add(hn::Add(hn::Add(a, e), hn::Mul(hn::Set(tag, 4.F), hn::Add(b, d))),
                        hn::Mul(hn::Set(tag, 6.F), c));
  return hn::Mul(sum, hn::Set(tag, 1.F / 16.F));
}

template <typename V>
HWY_INLINE V derived(V a, V b, V d, V e) {
  const hn::DFromV<V> tag;
  return hn::Mul(hn::Add(hn::Sub(e, a), hn::Mul(hn::Set(tag, 2.F), hn::Sub(d, b))),
                 hn::Set(tag, 1.F / 8.F));
}

/// Sixteen sums, one for each column, in vectors.
class ColumnSums {
 public:
  ColumnSums() {
    for (Floats& sum : sums_) sum = hn::Zero(kFloats);
  }
  void add(int column, Floats values) {
    Floats& sum = sums_[column / kFloatLanes];
    sum = hn::Add(sum, values);
  }
  float total() const {
    alignas(64) float columns[kPatchSide];
    for (int c = 0; c < kPatchSide; c += kFloatLanes) {
      hn::Store(sums_[c / kFloatLanes], kFloats, columns + c);
    }
    const hn::FixedTag<float, 4> d4;
    const auto quarter = hn::Add(hn::Add(hn::Load(d4, columns), hn::Load(d4, columns + 8)),
                                 hn::Add(hn::Load(d4, columns + 4), hn::Load(d4, columns + 12)));
    hn::Store(quarter, d4, columns);
    return (columns[0] + columns[2]) + (columns[1] + columns[3]);
  }

 private:
  Floats sums_[kPatchSide / kFloatLanes];
};

using Rows = float[kPatchSide][kPatchSide];

void removeMean(const ColumnSums& sums, Rows& rows) {
  const auto mean = hn::Set(kFloats, sums.total() * (1.F / (kPatchSide * kPatchSide)));
  for (auto& row : rows) {
    for (int c = 0; c < kPatchSide; c += kFloatLanes) {
      hn::Store(hn::Sub(hn::Load(kFloats, row + c), mean), kFloats, row + c);
    }
  }
}

void sumProducts(PatchTemplate& patch) {
  ColumnSums tt, tx, ty, xx, xy, yy;
  for (int r = 0; r < kPatchSide; ++r) {
    for (int c = 0; c < kPatchSide; c += kFloatLanes) {
      const auto t = hn::Load(kFloats, patch.value[r] + c);
      const auto x = hn::Load(kFloats, patch.dx[r] + c);
      const auto y = hn::Load(kFloats, patch.dy[r] + c);
      tt.add(c, hn::Mul(t, t));
      tx.add(c, hn::Mul(t, x));
      ty.add(c, hn::Mul(t, y));
      xx.add(c, hn::Mul(x, x));
      xy.add(c, hn::Mul(x, y));
      yy.add(c, hn::Mul(y, y));
    }
  }
  patch.tt = tt.total();
  patch.tx = tx.total();
  patch.ty = ty.total();
  patch.xx = xx.total();
  patch.xy = xy.total();
  patch.yy = yy.total();
}

// Processes the columns first, then the rows. In the other order, loads would overlap two recent
// stores and have to wait for both.
void prepare(const float* patch, PatchTemplate& out) {
  const hn::CappedTag<float, 8> wide;
  alignas(64) float smooth[kPatchSide][kWarpPitch];
  alignas(64) float slope[kPatchSide][kWarpPitch];
  for (int c = 0; c < kWarpPitch; c += static_cast<int>(hn::MaxLanes(wide))) {
    for (int r = 0; r < kPatchSide; ++r) {
      const auto row = [&](int i) { return hn::Load(wide, patch + (r + i) * kWarpPitch + c); };
      hn::Store(smoothed(row(0), row(1), row(2), row(3), row(4)), wide, smooth[r] + c);
      hn::Store(derived(row(0), row(1), row(3), row(4)), wide, slope[r] + c);
    }
  }
  ColumnSums value, dx, dy;
  for (int r = 0; r < kPatchSide; ++r) {
    for (int c = 0; c < kPatchSide; c += kFloatLanes) {
      const auto s = [&](int i) { return hn::LoadU(kFloats, smooth[r] + c + i); };
      const auto d = [&](int i) { return hn::LoadU(kFloats, slope[r] + c + i); };
      const auto t = smoothed(s(0), s(1), s(2), s(3), s(4));
      const auto x = derived(s(0), s(1), s(3), s(4));
      const auto y = smoothed(d(0), d(1), d(2), d(3), d(4));
      hn::Store(t, kFloats, out.value[r] + c);
      hn::Store(x, kFloats, out.dx[r] + c);
      hn::Store(y, kFloats, out.dy[r] + c);
      value.add(c, t);
      dx.add(c, x);
      dy.add(c, y);
    }
  }
  removeMean(value, out.value);
  removeMean(dx, out.dx);
  removeMean(dy, out.dy);
  sumProducts(out);
}

/// The sum of five sixteen-bit numbers with the binomial weights 1 4 6 4 1.
template <typename V>
HWY_INLINE V weighted(V a, V b, V c, V d, V e) {
  return hn::Add(hn::Add(hn::Add(a, e), hn::ShiftLeft<2>(hn::Add(b, d))),
                 hn::Add(hn::ShiftLeft<2>(c), hn::ShiftLeft<1>(c)));
}

void smooth(const std::uint8_t* pixel, std::ptrdiff_t stride, float* window) {
  const hn::CappedTag<std::uint16_t, 16> words;
  const hn::Rebind<std::uint8_t, decltype(words)> bytes;
  constexpr int kWordLanes = static_cast<int>(hn::MaxLanes(words));
  alignas(64) std::uint16_t across[kRawWindowSide][kWindowPitch];
  for (int r = 0; r < kRawWindowSide; ++r) {
    for (int c = 0; c < kWindowPitch; c += kWordLanes) {
      const auto at = [&](int i) {
        return hn::PromoteTo(words, hn::LoadU(bytes, pixel + r * stride + c + i));
      };
      hn::Store(weighted(at(0), at(1), at(2), at(3), at(4)), words, across[r] + c);
    }
  }
  const hn::RebindToSigned<decltype(kFloats)> integers;
  const hn::Rebind<std::uint16_t, decltype(kFloats)> few;
  const auto scale = hn::Set(kFloats, 1.F / 256.F);
  for (int c = 0; c < kWindowPitch; c += kFloatLanes) {
    for (int r = 0; r < kWindowSide; ++r) {
      const auto at = [&](int i) { return hn::Load(few, across[r + i] + c); };
      const auto sum = weighted(at(0), at(1), at(2), at(3), at(4));
      const auto value = hn::ConvertTo(kFloats, hn::PromoteTo(integers, sum));
      hn::Store(hn::Mul(value, scale), kFloats, window + r * kWindowPitch + c);
    }
  }
}

HWY_INLINE Floats mixed(const CubicWeights& w, Floats before, Floats at, Floats behind,
                        Floats last) {
  const auto times = [](float weight, Floats value) {
    return hn::Mul(hn::Set(kFloats, weight), value);
  };
  return hn::Add(hn::Add(times(w.before, before), times(w.at, at)),
                 hn::Add(times(w.behind, behind), times(w.last, last)));
}

MatchSums compare(const float* corner, float fx, float fy, const PatchTemplate& patch) {
  const CubicWeights x(fx);
  const CubicWeights y(fy);
  ColumnSums i, ii, ti, xi, yi;
  for (int c = 0; c < kPatchSide; c += kFloatLanes) {
    const auto across = [&](int row) {
      const float* p = corner + row * kWindowPitch + c;
      return mixed(x, hn::LoadU(kFloats, p - 1), hn::LoadU(kFloats, p), hn::LoadU(kFloats, p + 1),
                   hn::LoadU(kFloats, p + 2));
    };
    auto before = across(-1);
    auto at = across(0);
    auto behind = across(1);
    for (int row = 0; row < kPatchSide; ++row) {
      const auto last = across(row + 2);
      const auto value = mixed(y, before, at, behind, last);
      before = at;
      at = behind;
      behind = last;
      i.add(c, value);
      ii.add(c, hn::Mul(value, value));
      ti.add(c, hn::Mul(value, hn::Load(kFloats, patch.value[row] + c)));
      xi.add(c, hn::Mul(value, hn::Load(kFloats, patch.dx[row] + c)));
      yi.add(c, hn::Mul(value, hn::Load(kFloats, patch.dy[row] + c)));
    }
  }
  return {i.total(), ii.total(), ti.total(), xi.total(), yi.total()};
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace ktgp_orb::alignment
HWY_AFTER_NAMESPACE();
