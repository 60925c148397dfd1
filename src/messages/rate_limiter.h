#pragma once

#include <ros/time.h>

#include <cmath>
#include <cstdint>
#include <optional>

namespace ktgp_orb {

/// Leaves out frames so that no more than so many a second remain, evenly: time is cut into slots,
/// and the first frame of each is taken. Where the camera is as fast as the limit, each frame is in
/// the middle of its slot, so that stamps may shake by half a slot.
class RateLimiter {
 public:
  /// Hz; 0: all frames are taken. A change begins anew.
  void setRate(double rate) {
    if (rate != rate_) first_.reset();
    rate_ = rate;
  }

  /// Whether the frame with this stamp is taken. A stamp before the last one begins anew.
  bool takes(const ros::Time& stamp) {
    if (rate_ <= 0.0) return true;
    if (!first_ || stamp < last_) {
      first_ = stamp;
      slot_ = -1;
    }
    last_ = stamp;
    const double seconds = static_cast<double>(stamp.sec) - first_->sec +
                           1e-9 * (static_cast<double>(stamp.nsec) - first_->nsec);
    const auto slot = std::llround(rate_ * seconds);
    if (slot == slot_) return false;
    slot_ = slot;
    return true;
  }

 private:
  double rate_ = 0.0;
  std::optional<ros::Time> first_;
  ros::Time last_;
  long long slot_ = -1;
};

}  // namespace ktgp_orb
