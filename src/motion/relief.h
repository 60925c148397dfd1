#pragma once

#include "ktgp_orb/ground_motion.h"

namespace ktgp_orb::motion {

/// How far the ground is from flat, as far as the deviation of pictures from a plane tells it.
///
/// A single picture deviates from a plane by chance, too; relief shows in nearly all of them. Then
/// the picture sees a plane that is not quite the mean ground, which the readings are about.
class Relief {
 public:
  /// `deviation` from a plane: of a picture with focal length 1. `parallax`: way from the keyframe,
  /// as a share of the height.
  void add(double deviation, double parallax);
  bool isSeen() const;
  /// Readings with the deviation of the seen plane from the mean ground.
  HeightReading widened(HeightReading reading) const;
  DownReading widened(DownReading reading) const;

 private:
  double share_ = 0.0;  // of the pictures that deviate from a plane
  double size_ = 0.0;   // standard deviation of the ground from the seen plane, share of the height
};

}  // namespace ktgp_orb::motion
