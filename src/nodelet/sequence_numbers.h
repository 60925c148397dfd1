#pragma once

#include <cstdint>
#include <optional>

namespace ktgp_orb {

/// Counts the images that were lost on the way, by the publisher's counter (header.seq).
class SequenceNumbers {
 public:
  /// Images lost between the one before and this one. 0 where the counter does not go up: it began
  /// anew, or the publisher has none.
  std::uint32_t lostBefore(std::uint32_t number) {
    const std::optional<std::uint32_t> before = last_;
    last_ = number;
    if (!before || number <= *before) return 0;
    const std::uint32_t lost = number - *before - 1;
    return lost <= kMost ? lost : 0;
  }

  /// The next image is not compared to the one before.
  void restart() { last_.reset(); }

 private:
  static constexpr std::uint32_t kMost = 1000;  // more than that is another publisher's counter

  std::optional<std::uint32_t> last_;
};

}  // namespace ktgp_orb
