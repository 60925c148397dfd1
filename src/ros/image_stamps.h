#pragma once

#include <ros/time.h>

#include <cstdint>
#include <string>
#include <vector>

#include "util/stamp_order.h"

namespace ktgp_orb {

/// Detects images with wrong stamps. The stamps must be right, because users look up results by
/// their stamps and we compute velocities from the stamps.
class ImageStamps {
 public:
  enum class Wrong : std::uint8_t { nothing, zero, again, back, ahead };
  /// Name of the counter in the diagnostics, for example "stamps of zero".
  static const char* nameOf(Wrong wrong);

  /// Checks the stamp of the next image and returns what is wrong with it. `arrival`: time of the
  /// computer's clock when the image arrived; zero: unknown. If the delays from stamp to arrival
  /// were steady so far, returns `ahead` for a stamp that is much later than they predict; do not
  /// use its image. If the next stamp is ahead as well, accepts it, because the camera's clock was
  /// probably set. If the computer's clock went back, for example because a recording is played in
  /// a loop, a stamp that goes back as well is right.
  Wrong wrongWith(const ros::Time& stamp, const ros::Time& arrival);
  /// The newest stamp that is known to be wrong. If a stamp was ahead of its time but was accepted,
  /// the next stamp seems to go back, so wrongWith() first calls that next stamp wrong. Only the
  /// stamp after it shows which of the two was wrong.
  const ros::Time& wrong() const { return wrong_; }
  /// Explains why the last image with a stamp ahead of its time was refused.
  std::string reason() const;

 private:
  bool isAhead(const ros::Time& stamp, const ros::Time& arrival);

  util::StampOrder order_;
  ros::Time last_;
  ros::Time last_arrival_;
  ros::Time wrong_;
  ros::Time one_ahead_;        // stamp before the last jump back; may be wrong
  std::vector<double> leads_;  // stamp minus arrival time of the last images, s
  bool was_ahead_ = false;
  double ahead_ = 0.0;
};

}  // namespace ktgp_orb
