#pragma once

#include <cstdint>
#include <optional>

namespace ktgp_orb {

/// Counts lost images, using the publisher's counter (header.seq).
class SequenceNumbers {
 public:
  /// Images lost between the previous one and this one. 0 if the counter does not increase: it
  /// restarted, or the publisher does not count.
  std::uint32_t lostBefore(std::uint32_t number) {
    const std::optional<std::uint32_t> before = last_;
    last_ = number;
    if (!before || number <= *before) return 0;
    const std::uint32_t lost = number - *before - 1;
    return lost <= kMost ? lost : 0;
  }

  /// Do not compare the next image with the previous one.
  void restart() { last_.reset(); }

 private:
  static constexpr std::uint32_t kMost = 1000;  // a larger gap means another publisher's counter

  std::optional<std::uint32_t> last_;
};

}  // namespace ktgp_orb
