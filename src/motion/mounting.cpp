#include "motion/mounting.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <string>

#include "motion/camera_pose.h"
#include "motion/rows.h"
#include "util/constants.h"
#include "util/format.h"
#include "util/small_matrix.h"

namespace ktgp_orb::motion {
namespace {

using util::inverseOf;
using util::propagated;

constexpr double kBlock = 0.5;  // s
// Memories of the fit that is reported and of the recent one, s.
constexpr double kMemory = 300.0;
constexpr double kRecent = 20.0;
// Prior standard deviations of the mounting (rad), the delay (s), the bias (rad/s), the tilt (rad)
// and the relative scale error.
constexpr double kPrior[] = {0.35, 0.2, 0.1, 0.05, 0.1};
// An unknown is reported only if its standard deviation is smaller than this: mounting (rad), delay
// (s), bias (rad/s), scale error.
constexpr double kKnown[] = {0.0125, 0.02, 0.02, 0.01};
// If the estimated mounting error is larger than this, estimate() reports nothing, because the
// first-order model is not good enough.
constexpr double kLargest = 0.35;  // rad
// estimate() multiplies the variances by this factor, which was measured on flights. Without it
// they would be too small: successive differences share a block, so their errors are not
// independent.
constexpr double kShared = 1.5;
// kLeastNoise: minimum standard deviation of the difference between the means of two blocks. The
// difference is used to estimate the mounting and the scale only if the rotation between the two
// blocks is larger than kLeastTurn, and to estimate the delay only if the change of the angular
// velocity is larger than kLeastRate; see dropNoise().
constexpr double kLeastNoise = 2e-4;  // rad
constexpr double kLeastTurn = 0.02;   // rad
constexpr double kLeastRate = 0.02;   // rad/s
// Largest squared difference between the two fits, in deviations of the recent one: the 99.9 %
// quantile of the chi-squared distribution with kSize degrees of freedom. The fits share
// measurements, so their difference is smaller than that: on flights with a constant Imu it stayed
// below 8, and below 23 if the motion did not show all unknowns.
constexpr double kLargestChange = 31.3;

}  // namespace

void Mounting::Said::turn(const Eigen::Matrix3d& by) {
  value = by * value;
  slope = by * slope;
  covariance = by * covariance * by.transpose();
}

void Mounting::Said::add(const Said& other) {
  value += other.value;
  slope += other.slope;
  covariance += other.covariance;
}

Mounting::Said Mounting::Said::mean(int count) const {
  return {value / count, slope / count, covariance / count};
}

void Mounting::begin(const SeenTurn& seen, std::int64_t reference_stamp, bool gives_turns) {
  is_running_ = true;
  if (gives_turns != gives_turns_) fit_ = recent_ = {};  // the two kinds have different biases
  gives_turns_ = gives_turns;
  last_ = seen;
  reference_stamp_ = reference_stamp;
  rate_.setZero();
  turned_ = block_ = {};
  count_ = 0;
  seconds_ = 0.0;
  before_.reset();
}

void Mounting::endFrame() {
  if (!was_added_) is_running_ = false;
  was_added_ = false;
}

void Mounting::add(const SeenTurn& seen, std::int64_t reference_stamp, double seconds,
                   const std::optional<TurnReading>& turn, const std::optional<DownReading>& down) {
  constexpr int kPatience = 100;  // frames
  const bool gives_turns = turn.has_value();
  without_turn_ = gives_turns ? 0 : without_turn_ + 1;
  if (gives_turns_ && !gives_turns && without_turn_ < kPatience) return;
  was_added_ = true;
  if (!is_running_ || gives_turns != gives_turns_) {
    begin(seen, reference_stamp, gives_turns);
    return;
  }
  if (reference_stamp != reference_stamp_) last_ = {};
  // `step`: rotation from the camera's frame at the previous image to its frame at the newest
  // image, computed from the images.
  const Eigen::Matrix3d step = seen.rotation.transpose() * last_.rotation;
  const Eigen::Matrix3d by_tilt = seen.by_tilt - step * last_.by_tilt;
  last_ = seen;
  reference_stamp_ = reference_stamp;
  for (Said* each : {&turned_, &block_}) each->turn(step);
  if (before_) before_->turn(step);
  const Eigen::Vector3d rate_before = step * rate_;
  turned_.slope.middleCols<3>(kBias) += seconds * Eigen::Matrix3d::Identity();
  turned_.slope.middleCols<3>(kTilt) -= by_tilt;

  Said now;
  if (turn) {
    rate_ = turnOf(turn->rotation) / seconds;
    turned_.value += turnOf(step * turn->rotation) + turn->age * (rate_ - rate_before);
    turned_.slope.col(kScale) += turnOf(turn->rotation);
    turned_.slope.middleCols<3>(kMounting).setIdentity();
    turned_.slope.col(kDelay) = -rate_;
    now = turned_;
    now.covariance = seen.covariance;
    now.covariance.diagonal().array() += kBlock / seconds * std::pow(turn->deviation, 2);
  } else {
    rate_ = turnOf(step.transpose()) / seconds;
    const Eigen::Vector3d change = rate_.cross(down->direction);
    const Eigen::Matrix3d by_turn = crossed(down->direction);
    now.value = down->direction - down->age * change;
    now.slope = -by_turn * turned_.slope;
    now.slope.leftCols<4>() << by_turn, change;
    now.covariance = by_turn * seen.covariance * by_turn.transpose();
    now.covariance.diagonal().array() += std::pow(down->deviation, 2) * seconds / kBlock;
  }
  block_.add(now);
  ++count_;
  seconds_ += seconds;
  if (seconds_ >= kBlock) endBlock();
}

void Mounting::endBlock() {
  const Said mean = block_.mean(count_);
  if (before_) {
    Said difference = mean;
    difference.value -= before_->value;
    difference.slope -= before_->slope;
    const int freedom = gives_turns_ ? 3 : 2;  // of a rotation, of a direction
    fit_.learn(difference, freedom, std::exp(-seconds_ / kMemory));
    recent_.learn(difference, freedom, std::exp(-seconds_ / kRecent));
    if (contradict()) fit_ = recent_ = {};
  }
  before_ = mean;
  block_ = {};
  count_ = 0;
  seconds_ = 0.0;
}

/// Sets derivatives in `slope` to zero if they are so small that they may be mere noise with this
/// variance, or second-order effects. Over time they would add up to false information.
void Mounting::Fit::dropNoise(double variance, Slope& slope) {
  const Eigen::Matrix3d by_mounting = slope.middleCols<3>(kMounting);
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> parts(by_mounting.transpose() * by_mounting);
  for (int i = 0; i < 3; ++i) {
    if (parts.eigenvalues()(i) > variance + kLeastTurn * kLeastTurn) continue;
    const Eigen::Vector3d axis = parts.eigenvectors().col(i);
    slope.middleCols<3>(kMounting) -= by_mounting * axis * axis.transpose();
  }
  const double change = slope.col(kDelay).squaredNorm();
  if (change < variance / (kBlock * kBlock) + kLeastRate * kLeastRate) slope.col(kDelay).setZero();
  const double turned = slope.col(kScale).squaredNorm();
  if (turned < variance + kLeastTurn * kLeastTurn) slope.col(kScale).setZero();
}

void Mounting::Fit::learn(Said difference, int freedom, double kept) {
  Eigen::Matrix3d given = difference.covariance;
  given.diagonal().array() += kLeastNoise * kLeastNoise;
  dropNoise(4.0 * noise * given.trace(), difference.slope);
  const Eigen::Matrix3d expected = noise * given + propagated(difference.slope, covariance);
  const Eigen::Vector3d residual = difference.value - difference.slope * unknowns;
  const double misfit = std::sqrt(propagated(residual.transpose(), inverseOf(expected))(0, 0));
  information *= kept;
  weighted *= kept;
  square *= kept;
  rows *= kept;
  if (!std::isfinite(misfit)) return;
  const Eigen::Matrix3d weight = inverseOf(studentNoise(misfit, freedom) * given);
  information += propagated(difference.slope.transpose(), weight);
  weighted += difference.slope.transpose() * (weight * difference.value);
  square += difference.value.dot(weight * difference.value);
  rows += freedom;
  solve();
}

/// True if the Imu, or the slope of the ground, has probably changed: for example, the bias has
/// jumped. Student's weights alone would leave the new readings out for minutes. All unknowns are
/// compared, since in 20 s a bias looks like a wrong normal of the ground.
bool Mounting::contradict() const {
  const Unknowns change = recent_.unknowns - fit_.unknowns;
  const auto inverse = inverseOf(kShared * recent_.covariance);
  return propagated(change.transpose(), inverse)(0, 0) > kLargestChange;
}

/// Estimates the unknowns and the noise alternately, because they depend on each other. The
/// dependence is weak, so three rounds are enough.
void Mounting::Fit::solve() {
  constexpr double kRows = 10.0;  // the given noise counts as much as this many measurements
  Unknowns prior;
  prior << Eigen::Vector3d::Constant(kPrior[0]), kPrior[1], Eigen::Vector3d::Constant(kPrior[2]),
      Eigen::Vector3d::Constant(kPrior[3]), kPrior[4];
  for (int iteration = 0; iteration < 3; ++iteration) {
    const Information seen = information / noise;
    Information all = seen;
    all.diagonal().array() += prior.array().square().inverse();
    covariance = inverseOf(all);
    unknowns = covariance * weighted / noise;
    // Number of unknowns that the measurements (and not the prior) determine. The residuals lose
    // this many degrees of freedom.
    const double used = (covariance * seen).trace();
    const double rest =
        square - 2.0 * unknowns.dot(weighted) + unknowns.dot(information * unknowns);
    noise = (std::max(rest, 0.0) + kRows) / (std::max(rows - used, 0.0) + kRows);
  }
}

double Mounting::doubtOf(const Eigen::Vector3d& turn, double change,
                         const Eigen::Matrix3d& to_base) const {
  constexpr double kCertain = 3.0;  // deviations
  const std::optional<ImuMounting> imu = estimate(to_base);
  if (!imu) return 0.0;
  const double delay = std::abs(imu->delay) > kCertain * imu->delay_deviation ? imu->delay : 0.0;
  const Eigen::Vector3d rotation =
      (imu->rotation.array().abs() > kCertain * imu->rotation_deviation.array())
          .select(imu->rotation, 0.0);
  return std::hypot(delay * change, rotation.cross(to_base * turn).norm());
}

std::optional<ImuMounting> Mounting::estimate(const Eigen::Matrix3d& to_base) const {
  const double infinite = std::numeric_limits<double>::infinity();
  const auto deviation_of = [infinite](double variance, double largest) {
    const double deviation = std::sqrt(kShared * variance);
    return deviation < largest ? deviation : infinite;
  };
  ImuMounting imu;
  imu.rotation = to_base * fit_.unknowns.segment<3>(kMounting);
  imu.delay = fit_.unknowns(kDelay);
  imu.bias = to_base * fit_.unknowns.segment<3>(kBias);
  const Eigen::Matrix3d of_rotation =
      propagated(to_base, fit_.covariance.block<3, 3>(kMounting, kMounting));
  const Eigen::Matrix3d of_bias = propagated(to_base, fit_.covariance.block<3, 3>(kBias, kBias));
  const bool is_near = imu.rotation.norm() < kLargest;
  bool is_known = false;
  const auto report = [&](double& value, double& deviation, double variance, double largest) {
    deviation = is_near ? deviation_of(variance, largest) : infinite;
    if (!std::isfinite(deviation)) value = 0.0;
    is_known = is_known || std::isfinite(deviation);
  };
  report(imu.delay, imu.delay_deviation, fit_.covariance(kDelay, kDelay), kKnown[1]);
  // Converts the scale error and the bias.
  // In `fit_.unknowns`: true velocity = (1 - scale error) * reading - bias.
  // In the result: reading = (1 + scale error) * true velocity + bias.
  imu.scale_error = fit_.unknowns(kScale);
  report(imu.scale_error, imu.scale_error_deviation, fit_.covariance(kScale, kScale),
         gives_turns_ ? kKnown[3] : 0.0);
  const double scale = 1.0 / (1.0 - imu.scale_error);
  imu.scale_error *= scale;
  imu.scale_error_deviation *= scale * scale;
  imu.bias *= scale;
  for (int i = 0; i < 3; ++i) {
    report(imu.rotation(i), imu.rotation_deviation(i), of_rotation(i, i), kKnown[0]);
    report(imu.bias(i), imu.bias_deviation(i), of_bias(i, i), gives_turns_ ? kKnown[2] : 0.0);
  }
  if (!is_known) return std::nullopt;
  return imu;
}

}  // namespace ktgp_orb::motion

namespace ktgp_orb {
namespace {

constexpr double kDegrees = 180.0 / util::kPi;  // per rad
constexpr double kMilliseconds = 1e3;           // per s

/// Formats a value and its standard deviation. Both are rounded to the first significant digit of
/// the deviation, or to integers if the deviation is larger than 1.
std::string plusMinus(double value, double deviation, const std::string& unit) {
  const double places = -std::floor(std::log10(std::max(deviation, 1e-6)));
  const int digits = static_cast<int>(std::max(places, 0.0));
  return util::format("%.*f +- %.*f %s", digits, value, digits, deviation, unit.c_str());
}

/// Text that lists the axes for which is_shown is true, with their errors, e.g. "1.0 +- 0.1 degrees
/// off about x".
template <typename Show>
std::string axes(const Eigen::Vector3d& values, const Eigen::Vector3d& deviations,
                 const std::string& unit, const Show& is_shown) {
  std::string text;
  for (int i = 0; i < 3; ++i) {
    if (!is_shown(values(i), deviations(i))) continue;
    text += text.empty() ? "" : ", ";
    text +=
        plusMinus(kDegrees * values(i), kDegrees * deviations(i), unit) + " off about " + "xyz"[i];
  }
  return text;
}

std::string lateness(double delay, double deviation) {
  return plusMinus(kMilliseconds * std::abs(delay), kMilliseconds * deviation,
                   delay < 0.0 ? "ms early" : "ms late");
}

std::string largeness(double error, double deviation) {
  return plusMinus(100.0 * std::abs(error), 100.0 * deviation,
                   error < 0.0 ? "% too small" : "% too large");
}

void append(const char* what, const std::string& more, std::string& text) {
  if (!more.empty()) text += (text.empty() ? what : std::string("; ") + what) + more;
}

/// Returns a function that tells if a value is larger than `least` and too large for mere noise.
auto matters(double least) {
  return [least](double value, double deviation) {
    constexpr double kCertain = 4.0;  // deviations
    return std::abs(value) > least && std::abs(value) > kCertain * deviation;
  };
}

}  // namespace

std::string describe(const ImuMounting& imu) {
  const auto is_known = [](double, double deviation) { return std::isfinite(deviation); };
  std::string text;
  append("mounted ", axes(imu.rotation, imu.rotation_deviation, "degrees", is_known), text);
  if (is_known(imu.delay, imu.delay_deviation))
    append("stamps ", lateness(imu.delay, imu.delay_deviation), text);
  append("angular velocity ", axes(imu.bias, imu.bias_deviation, "degrees/s", is_known), text);
  if (is_known(imu.scale_error, imu.scale_error_deviation))
    append("its scale ", largeness(imu.scale_error, imu.scale_error_deviation), text);
  return text;
}

std::string troubleOf(const ImuMounting& imu) {
  const auto turns_too_far = matters(0.5 / kDegrees);  // rad
  const auto is_too_late = matters(0.004);             // s
  const auto drifts = matters(0.5 / kDegrees);         // rad/s
  // Scale error as a share of the true rotation. The limit is below 3 %, which is the scale error
  // that data sheets of cheap gyroscopes state.
  const auto is_another_scale = matters(0.02);
  std::string text;
  append("the Imu seems to be mounted ",
         axes(imu.rotation, imu.rotation_deviation, "degrees", turns_too_far), text);
  if (is_too_late(imu.delay, imu.delay_deviation))
    append("the Imu's stamps seem ", lateness(imu.delay, imu.delay_deviation), text);
  append("the Imu's angular velocity seems ",
         axes(imu.bias, imu.bias_deviation, "degrees/s", drifts), text);
  if (is_another_scale(imu.scale_error, imu.scale_error_deviation))
    append("the scale of the Imu's angular velocity seems ",
           largeness(imu.scale_error, imu.scale_error_deviation), text);
  return text;
}

}  // namespace ktgp_orb
