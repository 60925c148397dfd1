#pragma once

#include <ros/time.h>

#include <cstdint>
#include <string>
#include <vector>

#include "util/stamp_order.h"

namespace ktgp_orb {

/// Finds stamps of images that cannot be used: results are found by stamps, and velocities need
/// them.
class ImageStamps {
 public:
  enum class Wrong : std::uint8_t { nothing, zero, again, back, ahead };
  /// "stamps of zero", for example.
  static const char* nameOf(Wrong wrong);

  /// `arrival`: when the image came, by the clock
  /// of the computer; zero: not known. An image with a stamp ahead of its time must not be used:
  /// where images come as steadily as their stamps say, its arrival shows it at once. The second
  /// one in a row is believed, since the clock of the camera may have been set.
  Wrong wrongWith(const ros::Time& stamp, const ros::Time& arrival);
  /// The newest stamp that was wrong, as far as the images so far can tell: after one that was
  /// ahead, it is the next one that goes back.
  const ros::Time& wrong() const { return wrong_; }
  /// Why the image with the last stamp ahead of its time is not used.
  std::string reason() const;

 private:
  bool isAhead(const ros::Time& stamp, const ros::Time& arrival);

  util::StampOrder order_;
  ros::Time last_;
  ros::Time wrong_;
  ros::Time one_ahead_;        // the image before the newest one that went back
  std::vector<double> leads_;  // s, from arrival to stamp, of the newest images
  bool was_ahead_ = false;
  double ahead_ = 0.0;
};

}  // namespace ktgp_orb
