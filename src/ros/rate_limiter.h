#pragma once

#include <ros/time.h>

#include <cmath>
#include <optional>

namespace ktgp_orb {

/// Skips frames evenly to limit their rate: time is divided into slots, and the first frame of each
/// slot is used. The slots are placed so that the very first frame is in the middle of its slot. So
/// if the camera's rate equals the limit, every frame is near the middle of a slot, and stamps may
/// jitter by up to half a slot.
class RateLimiter {
 public:
  /// Sets the limit in Hz; 0: use all frames. If the rate changes, the slots start again at the
  /// next frame.
  void setRate(double rate) {
    if (rate != rate_) first_.reset();
    rate_ = rate;
  }

  /// Returns true if the frame with this stamp should be used. If the stamps go back, the slots
  /// start again at this frame.
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
