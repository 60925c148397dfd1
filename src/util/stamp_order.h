#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <utility>

namespace ktgp_orb::util {

/// Detects wrong stamps in a sequence of frames or messages by comparing neighbouring stamps. A
/// stamp that is before the newest accepted stamp, or far after it, is not accepted at first, but
/// set apart. If the next stamp continues from there, both are accepted: a recording was started
/// again, a clock was set, or the camera paused. Otherwise the stamp set apart was wrong and is
/// forgotten. A wrong stamp that is only a little ahead is accepted at first. It is recognised as
/// wrong if the next two stamps are in order and lie between the stamp before it and the wrong
/// stamp itself.
class StampOrder {
 public:
  struct Place {
    bool is_apart = false;  ///< this stamp was set apart, so it is not accepted yet
    /// The previous stamp was set apart, but was right: a new sequence began with it.
    bool restarted = false;
    /// The newest accepted stamp was wrong, and the stamp that was set apart after it was right.
    /// The sequence continues from the stamp set apart.
    bool was_one_ahead = false;
  };

  StampOrder() = default;
  /// Stamps that are out of order by up to `jitter`, ns, are accepted.
  explicit StampOrder(std::int64_t jitter) : jitter_(jitter) {}

  /// Decides on the next stamp, ns. If it is more than `longest`, ns, after the newest accepted
  /// stamp, it is set apart.
  Place next(std::int64_t stamp,
             std::uint64_t longest = std::numeric_limits<std::uint64_t>::max()) {
    Place place;
    const std::optional<std::int64_t> apart = std::exchange(apart_, std::nullopt);
    if (apart && !isBefore(stamp, *apart) && (*apart > *newest_ || isBehind(stamp))) {
      place.was_one_ahead = *apart < *newest_ && before_ && *apart + jitter_ > *before_;
      place.restarted = !place.was_one_ahead;
      newest_ = apart;
    }
    const bool is_newest = !newest_ || stamp >= *newest_;
    place.is_apart =
        isBehind(stamp) || (newest_ && is_newest && difference(stamp, *newest_) > longest);
    if (place.is_apart) {
      apart_ = stamp;
    } else if (is_newest) {
      before_ = std::exchange(newest_, stamp);
    }
    return place;
  }

  /// The stamp that was accepted before the newest accepted stamp.
  std::optional<std::int64_t> before() const { return before_; }
  bool isBehind(std::int64_t stamp) const { return newest_ && isBefore(stamp, *newest_); }

 private:
  bool isBefore(std::int64_t stamp, std::int64_t other) const { return stamp + jitter_ < other; }
  /// The result is unsigned, because the difference of two stamps may be too large for a signed
  /// number.
  static std::uint64_t difference(std::int64_t later, std::int64_t earlier) {
    return static_cast<std::uint64_t>(later) - static_cast<std::uint64_t>(earlier);
  }

  std::int64_t jitter_ = 0;
  std::optional<std::int64_t> before_;
  std::optional<std::int64_t> newest_;
  std::optional<std::int64_t> apart_;
};

}  // namespace ktgp_orb::util
