#include "ros/image_stamps.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <utility>

#include "ros/stamps.h"
#include "util/format.h"
#include "util/names.h"

namespace ktgp_orb {

const char* ImageStamps::nameOf(Wrong wrong) {
  return util::nameOf<Wrong::ahead>(
      wrong, {"no wrong stamps", "stamps of zero", "stamps as of the image before",
              "stamps that go back", "stamps ahead of their time"});
}

ImageStamps::Wrong ImageStamps::wrongWith(const ros::Time& stamp, const ros::Time& arrival) {
  if (stamp.isZero()) {
    wrong_ = stamp;
    return Wrong::zero;
  }
  if (!arrival.isZero() && arrival < std::exchange(last_arrival_, arrival) && stamp < last_) {
    order_ = {};
    leads_.clear();
  }
  if (isAhead(stamp, arrival)) {
    wrong_ = stamp;
    return Wrong::ahead;
  }
  const ros::Time before = std::exchange(last_, stamp);
  const util::StampOrder::Place place = order_.next(static_cast<std::int64_t>(stamp.toNSec()));
  if (place.was_one_ahead) wrong_ = one_ahead_;
  if (place.is_apart) {
    wrong_ = stamp;
    one_ahead_ = before;
    return Wrong::back;
  }
  if (stamp != before) return Wrong::nothing;
  wrong_ = stamp;
  return Wrong::again;
}

std::string ImageStamps::reason() const {
  return util::format(
      "its header.stamp, %.6f, is %.3f s ahead of its time, by its arrival and that of the images "
      "before it; expected the time of its exposure",
      wrong_.toSec(), ahead_);
}

bool ImageStamps::isAhead(const ros::Time& stamp, const ros::Time& arrival) {
  constexpr std::size_t kKept = 10;
  constexpr std::size_t kLeast = 3;
  // Seconds; unless the computer is overloaded, the delays between stamp and arrival of the images
  // differ by less than this.
  constexpr double kJitter = 0.1;
  // Seconds; if ten images at 30/s wait in a queue, each of them arrives late by about this much.
  constexpr double kBacklog = 0.35;
  if (arrival.isZero()) return false;
  const double lead = secondsBetween(arrival, stamp);
  const auto [least, most] = std::minmax_element(leads_.begin(), leads_.end());
  const bool is_steady = leads_.size() >= kLeast && *most - *least < kJitter;
  // When queued images arrive all at once, their delay is smaller than before, but the time between
  // their stamps is as usual. A wrong stamp is far after the previous stamp, so we check this step,
  // too.
  const bool is_step = secondsBetween(last_, stamp) > kBacklog;
  const bool is_ahead = is_steady && is_step && lead > *most + kBacklog;
  if (is_ahead) ahead_ = lead - *most;
  if (is_ahead && !std::exchange(was_ahead_, true)) return true;
  if (is_ahead) leads_.clear();
  was_ahead_ = false;
  leads_.reserve(kKept);
  if (leads_.size() == kKept) leads_.erase(leads_.begin());
  leads_.push_back(lead);
  return false;
}

}  // namespace ktgp_orb
