#include "motion/validity.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <stdexcept>
#include <string>

#include "util/camera_check.h"
#include "util/names.h"

namespace ktgp_orb {
namespace motion {
namespace {

void requireAtLeastZero(const char* name, double value) {
  if (value >= 0.0 && std::isfinite(value)) return;
  throw std::invalid_argument(std::string(name) + " is " + std::to_string(value) +
                              "; expected a number of at least 0");
}

template <typename Reading>
void requireUsable(const char* name, const std::optional<Reading>& reading) {
  const std::string trouble = reading ? whyUnusable(*reading) : "";
  if (!trouble.empty()) throw std::invalid_argument(name + (" " + trouble));
}

/// Returns true if the matrix is a rotation, not a mirror.
bool isRotation(const Eigen::Matrix3d& matrix) {
  constexpr double kRounding = 1e-6;
  return (matrix.transpose() * matrix - Eigen::Matrix3d::Identity()).norm() < kRounding &&
         matrix.determinant() > 0.0;
}

/// Returns true if the homography maps at least one point of a grid over the reference into the
/// image. A homography that was computed from matches always does.
bool haveCommonPart(const Eigen::Matrix3d& homography, const cv::Size& size) {
  constexpr int kSteps = 8;
  for (int i = 0; i <= kSteps; ++i) {
    for (int j = 0; j <= kSteps; ++j) {
      const Eigen::Vector3d from(size.width * i / double{kSteps}, size.height * j / double{kSteps},
                                 1.0);
      const Eigen::Vector2d to = (homography * from).hnormalized();
      if (to.x() >= 0.0 && to.x() <= size.width && to.y() >= 0.0 && to.y() <= size.height) {
        return true;
      }
    }
  }
  return false;
}

void requireOfTwoImages(const Eigen::Matrix3d& homography, const cv::Size& size) {
  if (!homography.allFinite()) {
    throw std::invalid_argument("the homography has a number that is not finite");
  }
  if (!(homography.determinant() > 0.0)) {
    throw std::invalid_argument("the homography mirrors the image, or makes it a line");
  }
  if (size.empty() || haveCommonPart(homography, size)) return;
  throw std::invalid_argument(
      "the homography moves the whole reference out of the image; expected a part in common");
}

}  // namespace

void requireValid(const GroundMotionOptions& options) {
  requireAtLeastZero("ground_slope", options.ground_slope);
  requireAtLeastZero("scale_deviation", options.scale_deviation);
  requireAtLeastZero("acceleration", options.acceleration);
  requireAtLeastZero("turn_acceleration", options.turn_acceleration);
  util::requireReadoutTime(options.readout_time);
  if (!(options.max_tilt_deviation > 0.0)) {
    throw std::invalid_argument("max_tilt_deviation is " +
                                std::to_string(options.max_tilt_deviation) +
                                "; expected an angle above 0 rad");
  }
  if (!isRotation(options.camera_to_base.linear()) ||
      !options.camera_to_base.translation().allFinite()) {
    throw std::invalid_argument("camera_to_base is not a rotation and a finite translation");
  }
}

void requireValid(const GroundFrame& frame) {
  requireUsable("the height", frame.height);
  requireUsable("the normal", frame.down);
  requireUsable("the rotation", frame.turn);
  util::requireK("the camera matrix", frame.camera, frame.size);
  if (!frame.answer) return;
  if (frame.reference_stamp == frame.stamp) {
    throw std::invalid_argument(
        "the frame is its own reference; expected the stamp of an earlier one");
  }
  requireAtLeastZero("plane_deviation", frame.answer->plane_deviation);
  requireOfTwoImages(frame.answer->homography, frame.size);
}

bool isUsable(const Covariance8& covariance) {
  if (!covariance.allFinite() || !(covariance.diagonal().minCoeff() > 0.0)) return false;
  const Eigen::Matrix<double, 8, 1> scale = covariance.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::Matrix<double, 8, 8> correlation =
      scale.asDiagonal() * covariance * scale.asDiagonal();
  return correlation.llt().info() == Eigen::Success;
}

}  // namespace motion

namespace {

/// Returns a text that says why a reading with this standard deviation or age cannot be used; empty
/// if it can.
std::string whyUnusable(double deviation, const char* unit, double age) {
  if (!(deviation >= 0.0) || !std::isfinite(deviation)) {
    return "has a standard deviation of " + std::to_string(deviation) + " " + unit +
           "; expected a number of at least 0";
  }
  return std::isfinite(age) ? "" : "has an age that is not finite";
}

}  // namespace

std::string whyUnusable(const HeightReading& reading) {
  if (!(reading.metres > 0.0) || !std::isfinite(reading.metres)) {
    return "is " + std::to_string(reading.metres) + " m; expected a number above 0";
  }
  std::string why = whyUnusable(reading.deviation, "m", reading.age);
  if (!why.empty()) return why;
  if (!reading.beam_origin.allFinite() || !reading.beam_direction.allFinite()) {
    return "has a beam that is not finite";
  }
  const double length = reading.beam_direction.norm();
  if (length != 0.0 && !(std::abs(length - 1.0) < 1e-6)) {
    return "has a beam whose direction has a length of " + std::to_string(length) +
           "; expected 1, or 0 for none";
  }
  return "";
}

std::string whyUnusable(const DownReading& reading) {
  if (!(std::abs(reading.direction.norm() - 1.0) < 1e-6)) {
    return "has a length of " + std::to_string(reading.direction.norm()) + "; expected 1";
  }
  return whyUnusable(reading.deviation, "rad", reading.age);
}

std::string whyUnusable(const TurnReading& reading) {
  if (!motion::isRotation(reading.rotation)) return "is not a rotation matrix";
  return whyUnusable(reading.deviation, "rad", reading.age);
}

const char* toString(GroundStatus status) {
  return util::nameOf<GroundStatus::looks_away>(
      status, {"ok", "started", "resumed", "no_homography", "no_covariance", "no_height",
               "no_normal", "contradiction", "stamp_went_back", "not_finite", "looks_away"});
}

}  // namespace ktgp_orb
