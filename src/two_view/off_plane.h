#pragma once

#include <optional>
#include <vector>

#include "estimation/prosac.h"
#include "two_view/epipolar.h"
#include "two_view/hypotheses.h"
#include "two_view/shared_errors.h"

namespace ktgp_orb::two_view {

/// Fits a motion to the pairs off the dominant plane alone. If the scene is rigid, this motion
/// explains the plane, too. If it does not, one of the two parts moves: the plane is the side of a
/// vehicle, for example, or the bonnet of the camera's own car. A motion fitted to all pairs is
/// then a compromise that may agree with most of both parts, because the Sampson distance does not
/// restrict a point along its epipolar line. Reuses its buffers from call to call.
class OffPlane {
 public:
  /// Returns the motion of the pairs off the plane if it contradicts `answer`, the motion of all
  /// pairs. `on_plane`: not 0 for each pair on the plane. `max_error`: limit of the Sampson
  /// distance, px. `cell`, `range`: see Hypotheses::load, px.
  std::optional<OtherMotion> contradicting(const RelativePose& answer, const PointPairs& pairs,
                                           const std::vector<std::uint8_t>& on_plane,
                                           const std::vector<double>* deviations,
                                           const Cameras& cameras, const SharedShifts& shared,
                                           double max_error, double cell, double range);

 private:
  PointPairs points_;
  std::vector<double> deviations_;
  estimation::QualityOrder order_;
  EpipolarPairs pairs_;
  Hypotheses motions_;
  EpipolarFit fit_;
};

}  // namespace ktgp_orb::two_view
