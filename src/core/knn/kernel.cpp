#include "core/knn/kernel.h"

#include <cstddef>

namespace ktgp_orb {
namespace {

// Sixteen bytes, which every 64-bit processor has vectors for. The compiler's own vector type keeps
// this independent of the processor; 16-bit lanes because SSE2 cannot shift bytes.
using Words __attribute__((vector_size(16))) = std::uint16_t;
using Keys __attribute__((vector_size(16))) = std::int16_t;

constexpr std::ptrdiff_t kRowBytes = sizeof(Words);
constexpr int kLanes = kRowBytes / 2;
constexpr std::ptrdiff_t kGroupBytes = kRowsPerGroup * kRowBytes;

Words load(const std::uint8_t* row) {
  return *reinterpret_cast<const Words*>(row);
}

/// Number of bits set in every byte: sums of neighbouring bits, then pairs, then nibbles.
Words countBits(Words v) {
  v = v - ((v >> 1) & 0x5555);
  v = (v & 0x3333) + ((v >> 2) & 0x3333);
  return (v + (v >> 4)) & 0x0f0f;
}

/// Sums of the distances in kRowsPerSum rows from `first`.
Words sumRows(const std::uint8_t* group, int first, const Words* query) {
  Words sum = {};
  for (int b = first; b < first + kRowsPerSum; ++b) {
    sum += countBits(load(group + b * kRowBytes) ^ query[b]);
  }
  return sum;
}

Keys minimum(Keys a, Keys b) {
  return a < b ? a : b;
}

Keys maximum(Keys a, Keys b) {
  return a < b ? b : a;
}

void scanOne(const std::uint8_t* block, int group_count, const std::uint8_t* descriptor,
             LaneKeys& keys) {
  Words query[kDescriptorBytes];
  for (int b = 0; b < kDescriptorBytes; ++b) {
    query[b] = Words{} + static_cast<std::uint16_t>(descriptor[b] * 0x0101);
  }
  Keys best = Keys{} + kNoKey;
  Keys second = best;
  for (int g = 0; g < group_count; ++g) {
    const std::uint8_t* group = block + g * kGroupBytes;
    const Words front = sumRows(group, 0, query);
    const Words back = sumRows(group, kRowsPerSum, query);
    const Words distances[2] = {(front & 0xff) + (back & 0xff), (front >> 8) + (back >> 8)};
    for (int half = 0; half < 2; ++half) {
      const Words number = load(group + (kDescriptorBytes + half) * kRowBytes);
      const Keys key = reinterpret_cast<Keys>((distances[half] << kKeyNumberBits) | number);
      second = minimum(second, maximum(best, key));
      best = minimum(best, key);
    }
  }
  *reinterpret_cast<Keys*>(keys.best) = best;
  *reinterpret_cast<Keys*>(keys.second) = second;
}

void scan(const std::uint8_t* block, int group_count, const QueryPass& queries, LaneKeys* keys) {
  for (int q = 0; q < kQueriesPerPass; ++q) {
    scanOne(block, group_count, queries.descriptor[q], keys[q]);
  }
}

}  // namespace

KnnKernel portableKnnKernel() {
  return {"portable", kLanes, &scan};
}

std::vector<KnnKernel> supportedKnnKernels() {
  std::vector<KnnKernel> kernels;
#ifdef KTGP_ORB_HAVE_HIGHWAY
  kernels = highwayKnnKernels();
#endif
  kernels.push_back(portableKnnKernel());
  return kernels;
}

}  // namespace ktgp_orb
