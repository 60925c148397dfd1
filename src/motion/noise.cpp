#include "motion/noise.h"

#include <Eigen/Cholesky>

#include "estimation/student.h"
#include "motion/rows.h"

namespace ktgp_orb::motion {
namespace {

// Errors of the plane that is fitted to the ground in an image, per unit of Relief::size_ (the
// deviation of the ground from this plane, as a share of the camera's height). The plane follows
// most of the relief, so its height is wrong by about twice the deviation (kOfPlane). Half of the
// image shows a strip of ground that is about a third of the camera's height wide. Over this width,
// the same error of the height tilts the plane by 2 / (1/3) = 6 times the deviation (kOfSlope).
constexpr double kOfPlane = 2.0;
constexpr double kOfSlope = 6.0;  // rad

/// Returns the Cholesky factor of the twist's covariance with the components in reversed order:
/// angular velocity, velocity along the optical axis, velocity across it. The squared diagonal of
/// the factor holds the variance of each component, given the components before it.
Eigen::LLT<Matrix6> factorOf(const Matrix6& covariance) {
  return Eigen::LLT<Matrix6>(covariance.reverse());
}

/// Means over the three parts of a twist: turning, approach and shift. `reversed`: components in
/// the order of factorOf().
Eigen::Array3d partsOf(const Eigen::Array<double, 6, 1>& reversed) {
  return {reversed.head<3>().mean(), reversed(3), reversed.tail<2>().mean()};
}

/// Variances of the three parts of the motion in `seconds`: rad² for turning, otherwise as a share
/// of the squared height.
Eigen::Array3d partsOf(const Eigen::LLT<Matrix6>& factor, double seconds, double height) {
  Eigen::Array<double, 6, 1> deviations = seconds * factor.matrixLLT().diagonal();
  deviations.tail<3>() /= height;
  return partsOf(deviations.square());
}

}  // namespace

double studentNoise(double misfit, int dimensions) {
  // Largest squared misfit per dimension that counts as normal noise.
  constexpr double kNormal = 3.0;
  const double weight = estimation::studentWeight(misfit * misfit, 1.0, kNormal * dimensions);
  return std::max(1.0, 1.0 / weight);
}

void Relief::add(double deviation, double parallax) {
  constexpr double kPictures = 30.0;
  constexpr double kLeastParallax = 0.05;  // with a smaller parallax, relief cannot be seen
  if (parallax < kLeastParallax) return;
  share_ += ((deviation > 0.0 ? 1.0 : 0.0) - share_) / kPictures;
  size_ += (deviation / parallax - size_) / kPictures;
}

bool Relief::isSeen() const {
  return share_ > 0.9;
}

HeightReading Relief::widened(HeightReading reading) const {
  if (isSeen())
    reading.deviation = std::hypot(reading.deviation, kOfPlane * size_ * reading.metres);
  return reading;
}

DownReading Relief::widened(DownReading reading) const {
  if (isSeen()) reading.deviation = std::hypot(reading.deviation, kOfSlope * size_);
  return reading;
}

void TwistNoise::add(const Vector6& twist, const Matrix6& noise, double seconds, double height) {
  constexpr double kDifference[kTwists] = {1.0, -4.0, 6.0, -4.0, 1.0};
  // Variance of the fourth difference of twists, if the poses have independent errors of variance
  // 1/2, so that each twist has the variance 1. The fourth difference of the twists is the fifth
  // difference of the poses, so its variance is half of 1 + 25 + 100 + 100 + 25 + 1.
  constexpr double kVariance = 126.0;
  constexpr double kNewer = 30.0;    // twists
  constexpr double kOlder = 300.0;   // twists
  constexpr double kLargest = 10.0;  // upper limit of a squared error, because of outliers
  // If the time between frames changes by more than this share, a new series of twists begins.
  constexpr double kJitter = 0.2;
  // rad (about a pixel). Twists with a smaller motion are not used: while the camera stands still,
  // the error of the homography does not change, so these twists do not show the noise.
  constexpr double kStandsStill = 0.002;

  const Eigen::LLT<Matrix6> factor = factorOf(noise);
  const bool is_usable = factor.info() == Eigen::Success;  // else it consists of rounding errors
  if (is_usable) {
    const Eigen::Array3d given = partsOf(factor, seconds, height);
    if (count_ < 0) first_ = given / kOfFrame;
    least_ = first_ / given;
  }
  if (!(std::abs(seconds - seconds_) <= kJitter * seconds_)) restart();
  seconds_ = seconds;
  ++count_;
  std::move_backward(twists_.begin(), twists_.end() - 1, twists_.end());
  twists_[0] = twist;
  const double moved = seconds * std::max(twist.head<3>().norm() / height, twist.tail<3>().norm());
  if (!is_usable || count_ < kTwists || moved < kStandsStill) return;

  Vector6 rough = Vector6::Zero();
  for (int i = 0; i < kTwists; ++i) rough += kDifference[i] * twists_[static_cast<std::size_t>(i)];
  const Vector6 reversed = rough.reverse();
  const Vector6 errors = factor.matrixL().solve(reversed);
  const Eigen::Array<double, 6, 1> squares = (errors.array().square() / kVariance).min(kLargest);
  const Eigen::Array3d seen = partsOf(squares);
  learned_ = std::min(learned_ + 1.0, kOlder);
  newer_ += (seen - newer_) / kNewer;
  older_ += (seen - older_) / std::max(learned_, kNewer);
}

Matrix6 TwistNoise::scaled(const Matrix6& noise) const {
  constexpr double kLeast = 0.05;
  const Eigen::LLT<Matrix6> factor = factorOf(noise);
  if (count_ < 1 || factor.info() != Eigen::Success) return noise;
  const Eigen::Array3d shares = newer_.max(older_).max(least_).max(kLeast).min(1.0);
  Vector6 each;
  each << shares(0), shares(0), shares(0), shares(1), shares(2), shares(2);
  const Matrix6 lower = factor.matrixL();
  return Matrix6(lower * each.asDiagonal() * lower.transpose()).reverse();
}

}  // namespace ktgp_orb::motion
