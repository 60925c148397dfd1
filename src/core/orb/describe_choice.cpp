#include "core/orb/describe_choice.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <limits>

namespace ktgp_orb::orb {
namespace {

constexpr int kRounds = 5;  // the fastest counts, since others may have been interrupted
constexpr int kCalls = 64;

/// A patch of pixels, described repeatedly, at another angle each time.
class Trial {
 public:
  Trial() {
    for (std::size_t i = 0; i < pixels_.size(); ++i) {
      pixels_[i] = static_cast<std::uint8_t>(i * 2654435761U >> 24);
    }
  }

  double seconds(OrbKernels::Describe describe) {
    const auto start = std::chrono::steady_clock::now();
    for (int i = 0; i < kCalls; ++i) {
      const auto angle = static_cast<float>(i);
      describe(pixels_.data() + kMiddle, kSide, std::cos(angle), std::sin(angle),
               descriptor_.data());
      pixels_[i] ^= descriptor_[0];  // keeps the compiler from removing the calls
    }
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  }

 private:
  static constexpr std::ptrdiff_t kSide = 64;
  static constexpr std::ptrdiff_t kMiddle = kSide / 2 * (kSide + 1);
  std::array<std::uint8_t, static_cast<std::size_t>(kSide* kSide)> pixels_;
  std::array<std::uint8_t, 32> descriptor_{};
};

}  // namespace

OrbKernels::Describe fasterDescribe(const OrbKernels& kernels) {
  if (kernels.describe == kernels.describe_by_gathers) return kernels.describe;
  Trial trial;
  double one_by_one = std::numeric_limits<double>::infinity();
  double by_gathers = one_by_one;
  for (int i = 0; i < kRounds; ++i) {
    one_by_one = std::min(one_by_one, trial.seconds(kernels.describe));
    by_gathers = std::min(by_gathers, trial.seconds(kernels.describe_by_gathers));
  }
  return by_gathers < one_by_one ? kernels.describe_by_gathers : kernels.describe;
}

}  // namespace ktgp_orb::orb
