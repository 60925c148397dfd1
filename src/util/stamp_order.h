#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <utility>

namespace ktgp_orb::util {

/// Tells which stamp of a sequence is wrong, by those around it. A stamp before the newest one, or
/// far beyond it, stays apart: if the next one continues from it, both are believed (a looped
/// recording, a clock that was set, a camera that paused); if not, it was wrong and is forgotten. A
/// stamp that was a little ahead is accepted at first; two stamps in order between the one before
/// it and itself show that it was wrong.
class StampOrder {
 public:
  struct Place {
    bool is_apart = false;       ///< the stamp stays apart
    bool restarted = false;      ///< the one before, which was apart, is where the sequence begins
    bool was_one_ahead = false;  ///< the last one that was accepted was wrong, the one after it
                                 ///< right: the sequence goes on
  };

  /// `longest`: a larger step is far, ns.
  Place next(std::int64_t stamp,
             std::uint64_t longest = std::numeric_limits<std::uint64_t>::max()) {
    Place place;
    const std::optional<std::int64_t> apart = std::exchange(apart_, std::nullopt);
    if (apart && stamp >= *apart && (*apart > *newest_ || stamp < *newest_)) {
      place.was_one_ahead = *apart < *newest_ && before_ && *apart > *before_;
      place.restarted = !place.was_one_ahead;
      newest_ = apart;
    }
    place.is_apart = newest_ && (stamp < *newest_ || difference(stamp, *newest_) > longest);
    if (place.is_apart) {
      apart_ = stamp;
    } else {
      before_ = std::exchange(newest_, stamp);
    }
    return place;
  }

  /// The one before the newest of those that were accepted.
  std::optional<std::int64_t> before() const { return before_; }
  bool isBehind(std::int64_t stamp) const { return newest_ && stamp < *newest_; }

 private:
  /// Two stamps may differ by more than half the range.
  static std::uint64_t difference(std::int64_t later, std::int64_t earlier) {
    return static_cast<std::uint64_t>(later) - static_cast<std::uint64_t>(earlier);
  }

  std::optional<std::int64_t> before_;
  std::optional<std::int64_t> newest_;
  std::optional<std::int64_t> apart_;
};

}  // namespace ktgp_orb::util
