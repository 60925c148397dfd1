#include "sequence/motion_predictor.h"

#include <Eigen/LU>
#include <algorithm>

namespace ktgp_orb::sequence {
namespace {

// A match is poor if it has less than this share of the inliers of the last match.
constexpr double kKeptShare = 0.5;

double nanoseconds(std::int64_t from, std::int64_t to) {
  return static_cast<double>(to) - static_cast<double>(from);
}

}  // namespace

std::optional<Eigen::Matrix3d> MotionPredictor::predict(const Frame& reference,
                                                        const Frame& next) const {
  std::optional<Eigen::Matrix3d> last = lastSeenFrom(reference);
  if (!last || !motion_) return last;
  // Extrapolate the last motion to at most this many times its duration.
  constexpr double kLongest = 3.0;
  const double interval = nanoseconds(stamp_, next.stamp);
  const double known = duration_ > 0 ? interval / static_cast<double>(duration_) : 1.0;
  const double ratio = std::clamp(known, 0.0, kLongest);
  // The homography of the last motion differs from the identity; multiply this difference by the
  // ratio of the times. This linear approximation is accurate enough between two frames.
  const Eigen::Matrix3d identity = Eigen::Matrix3d::Identity();
  const Eigen::Matrix3d carried = identity + ratio * (*motion_ / (*motion_)(2, 2) - identity);
  // If the predicted image would be mirrored or vanish, assume that there is no motion.
  const bool usable = carried.allFinite() && carried.determinant() > 1e-3;
  return (usable ? carried : identity) * *last;
}

std::optional<Eigen::Matrix3d> MotionPredictor::lastSeenFrom(const Frame& reference) const {
  if (&reference == last_) return Eigen::Matrix3d::Identity();
  if (&reference == reference_) return from_reference_;
  return std::nullopt;
}

bool MotionPredictor::isPoor(const MatchResult& result) const {
  return result.status != Status::ok ||
         static_cast<double>(result.inliers) < kKeptShare * static_cast<double>(inliers_);
}

void MotionPredictor::advance(const Frame& frame, const Frame& reference,
                              const MatchResult& result) {
  if (result.homographyStatus() != Status::ok) {
    restartAt(frame);
    return;
  }
  std::optional<Eigen::Matrix3d> last = lastSeenFrom(reference);
  motion_.reset();
  if (last) motion_ = result.answer.homography * last->inverse();
  duration_ = frame.stamp - stamp_;
  last_ = &frame;
  reference_ = &reference;
  stamp_ = frame.stamp;
  from_reference_ = result.answer.homography;
  inliers_ = result.inliers;
}

void MotionPredictor::replace(const Frame& frame, const Frame& fresh) {
  if (last_ == &frame) last_ = &fresh;
  if (reference_ == &frame) reference_ = &fresh;
}

void MotionPredictor::restartAt(const Frame& frame) {
  forget();
  last_ = &frame;
  stamp_ = frame.stamp;
}

}  // namespace ktgp_orb::sequence
