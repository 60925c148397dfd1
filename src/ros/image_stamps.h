#pragma once

#include <ros/time.h>

#include <cstdint>
#include <string>
#include <vector>

#include "util/stamp_order.h"

namespace ktgp_orb {

/// Detects images with wrong stamps. Stamps must be right, since users look up results by stamp and
/// velocities are computed from stamps.
class ImageStamps {
 public:
  enum class Wrong : std::uint8_t { nothing, zero, again, back, ahead };
  /// Name of the counter in the diagnostics, for example "stamps of zero".
  static const char* nameOf(Wrong wrong);

  /// Returns what is wrong with the stamp of the next image. `arrival`: when the image arrived, by
  /// the clock of the computer; zero: not known. If the delays from stamp to arrival were steady, a
  /// stamp ahead of its time is detected at once; do not use its image. If the next stamp is ahead,
  /// too, it is accepted, since the clock of the camera may have been set.
  Wrong wrongWith(const ros::Time& stamp, const ros::Time& arrival);
  /// The newest stamp that is known to be wrong. If an accepted stamp was ahead, the next stamp
  /// goes back and counts as wrong at first. The third stamp shows which of the two was wrong.
  const ros::Time& wrong() const { return wrong_; }
  /// Why the last image with a stamp ahead of its time is not used.
  std::string reason() const;

 private:
  bool isAhead(const ros::Time& stamp, const ros::Time& arrival);

  util::StampOrder order_;
  ros::Time last_;
  ros::Time wrong_;
  ros::Time one_ahead_;        // predecessor of the last stamp that went back; may be ahead
  std::vector<double> leads_;  // stamp minus arrival of the newest images, s
  bool was_ahead_ = false;
  double ahead_ = 0.0;
};

}  // namespace ktgp_orb
