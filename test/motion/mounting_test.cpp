// Estimates of the Imu's mounting, stamps and bias, on flights with known ones;
// how large the noise of a twist is, and whether the ground is flat.

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "allocation_counter.h"
#include "ground_flight.h"
#include "motion/noise.h"
#include "motion/rows.h"

namespace ktgp_orb {
namespace {

using motion::CameraPose;
using motion::rotationAbout;
using test::kDegree;
using test::kRate;
using test::mounted;

Eigen::Vector3d degrees(double x, double y, double z) {
  return kDegree * Eigen::Vector3d(x, y, z);
}

/// Yaw, pitch and roll of the base, rad, after t seconds.
using Turns = std::function<Eigen::Vector3d(double)>;

Eigen::Vector3d lively(double t) {
  return {0.5 * std::sin(0.9 * t), 0.12 * std::sin(1.3 * t), 0.1 * std::sin(1.1 * t)};
}

/// Faults of the Imu, in the base frame.
struct Rig {
  Eigen::Vector3d rotation = Eigen::Vector3d::Zero();
  double delay = 0.0;
  Eigen::Vector3d bias = Eigen::Vector3d::Zero();
  double scale_error = 0.0;
};

enum class Gives { turns, directions };

/// A camera at four metres with an Imu.
class Flight : public test::GroundPictures {
 public:
  explicit Flight(Gives gives, unsigned seed = 1) : GroundPictures(1e-4, seed), gives_(gives) {}

  Rig rig;
  Turns turns = lively;
  double speed = 2.5;        // m/s
  double gyro_noise = 3e-4;  // rad per frame
  double tilt_noise = 0.1 * kDegree;
  bool is_of_imu = true;
  double age = 0.0;         // age of the readings, s
  int gap_every = 1 << 30;  // frames: then one has no homography

  GroundFrame next() {
    const int frame = frame_++;
    const double t = frame / kRate;
    const CameraPose pose = poseAt(t);
    GroundFrame result = seenFrom(pose);
    if (frame % gap_every == 5) result.answer.reset();
    result.height = HeightReading{pose.position.z(), 0.01 * pose.position.z()};
    // The frame in which the Imu is said to be, seen from the one in which it is.
    const Eigen::Matrix3d to_base = mounted().linear();
    const Eigen::Matrix3d said = rotationAbout(-(to_base.transpose() * rig.rotation));
    const double late = rig.delay + age;
    DownReading down;
    const Eigen::Vector3d direction = said * -poseAt(t - late).axes.row(2).transpose();
    down.direction = (rotationAbout(tilt_noise * shake()) * direction).normalized();
    down.deviation = tilt_noise;
    down.of_imu = is_of_imu;
    down.age = age;
    if (gives_ == Gives::turns && frame > 0) {
      const Eigen::Matrix3d turn =
          poseAt(t - 1.0 / kRate - late).axes.transpose() * poseAt(t - late).axes;
      const Eigen::Vector3d wrong = to_base.transpose() * rig.bias / kRate + gyro_noise * shake();
      result.turn.emplace();
      const Eigen::Matrix3d scaled = rotationAbout((1.0 + rig.scale_error) * motion::turnOf(turn));
      result.turn->rotation = said * scaled * said.transpose() * rotationAbout(wrong);
      result.turn->deviation = gyro_noise;
      result.turn->age = age;
    }
    result.down = down;
    return result;
  }

  const GroundEstimate& add(const GroundFrame& frame) { return ground_.add(frame); }
  const GroundEstimate& step() { return add(next()); }
  /// The estimate after that time.
  std::optional<ImuMounting> after(double seconds) {
    for (int i = 1; i < seconds * kRate; ++i) step();
    return step().imu;
  }

 private:
  CameraPose poseAt(double t) const {
    const Eigen::Vector3d position(speed * t, 1.5 * std::sin(0.3 * speed * t), 4.0);
    return test::cameraAt(position, turns(t), mounted());
  }

  Gives gives_;
  GroundMotion ground_{test::optionsWith(mounted())};
  int frame_ = 0;
};

struct Case {
  Gives gives;
  Rig rig;
};

void expectFound(const std::optional<ImuMounting>& imu, const Rig& rig, double rotation,
                 double delay) {
  ASSERT_TRUE(imu);
  const std::string text = describe(*imu);
  EXPECT_LT((imu->rotation - rig.rotation).norm(), rotation * kDegree) << text;
  EXPECT_LT(imu->rotation_deviation.norm(), rotation * kDegree) << text;
  EXPECT_NEAR(imu->delay, rig.delay, delay) << text;
  EXPECT_LT(imu->delay_deviation, delay) << text;
}

/// A degree about each axis, 20 ms late and early, and a gyroscope with a bias.
std::vector<Case> rigs() {
  std::vector<Case> cases;
  for (const Gives gives : {Gives::turns, Gives::directions}) {
    for (int i = 0; i < 3; ++i) {
      cases.push_back({gives, {kDegree * Eigen::Vector3d::Unit(i)}});
      cases.push_back({gives, {-kDegree * Eigen::Vector3d::Unit(i), 0.01}});
    }
    for (const double delay : {0.02, -0.02}) cases.push_back({gives, {{}, delay}});
  }
  cases.push_back({Gives::turns, {degrees(0.5, 0.0, -0.5), 0.01, degrees(0.3, -1.0, 0.7)}});
  return cases;
}

TEST(Mounting, FindsOneDegreeAnd20MillisecondsInAMinute) {
  for (const Case& each : rigs()) {
    Flight flight(each.gives);
    flight.rig = each.rig;
    const auto imu = flight.after(60.0);
    expectFound(imu, each.rig, 0.25, 0.003);
    if (each.gives == Gives::turns) {
      EXPECT_LT((imu->bias - each.rig.bias).norm(), 0.15 * kDegree) << describe(*imu);
      EXPECT_LT(imu->bias_deviation.norm(), 0.15 * kDegree) << describe(*imu);
    } else {
      EXPECT_EQ(imu->bias, Eigen::Vector3d::Zero());
      EXPECT_TRUE(std::isinf(imu->bias_deviation.minCoeff()));
    }
  }
}

// A wrong scale is not called a bias, a mounting or a delay, and is found beside them.
TEST(Mounting, AWrongScaleOfTheGyroscopeIsNamed) {
  const Turns mostly_yaw = [](double t) {
    return Eigen::Vector3d(1.5 * std::sin(0.4 * t), 0.1 * std::sin(1.3 * t), 0.08 * std::sin(t));
  };
  for (const double error : {0.1, -0.06, 0.03}) {
    for (const bool has_bias : {false, true}) {
      for (const Turns& turns : {Turns(lively), mostly_yaw}) {
        Flight flight(Gives::turns);
        flight.turns = turns;
        flight.rig.scale_error = error;
        if (has_bias) flight.rig.bias = degrees(0.0, 0.0, 1.0);
        const auto imu = flight.after(60.0);
        ASSERT_TRUE(imu);
        const std::string text = troubleOf(*imu);
        EXPECT_NEAR(imu->scale_error, error, 0.005) << text;
        EXPECT_LT(imu->scale_error_deviation, 0.005) << text;
        EXPECT_NE(text.find("the scale of the Imu's angular velocity seems"), std::string::npos)
            << text;
        EXPECT_EQ(text.find("mounted"), std::string::npos) << text;
        EXPECT_EQ(text.find("stamps"), std::string::npos) << text;
        EXPECT_EQ(text.find("about z") != std::string::npos, has_bias) << text;
      }
    }
  }
}

TEST(Mounting, ARightScaleIsNotCalledWrong) {
  for (const unsigned seed : {1U, 2U, 3U}) {
    Flight flight(Gives::turns, seed);
    flight.rig.bias = degrees(0.5, -0.5, 1.0);
    const auto imu = flight.after(60.0);
    ASSERT_TRUE(imu);
    EXPECT_LT(std::abs(imu->scale_error), 4.0 * imu->scale_error_deviation);
    EXPECT_EQ(troubleOf(*imu).find("scale"), std::string::npos) << troubleOf(*imu);
  }
}

TEST(Mounting, ErrorsAreAsLargeAsTheirDeviations) {
  constexpr int kFlights = 16;
  for (const Gives gives : {Gives::turns, Gives::directions}) {
    for (const double image_noise : {3e-5, 4e-4}) {
      Eigen::Matrix<double, 7, 1> squares = Eigen::Matrix<double, 7, 1>::Zero();
      for (int i = 0; i < kFlights; ++i) {
        Flight flight(gives, 100 + static_cast<unsigned>(i));
        flight.image_noise = image_noise;
        flight.rig = {degrees(0.5, -0.3, 0.8), 0.01};
        const auto imu = flight.after(30.0);
        ASSERT_TRUE(imu);
        Eigen::Matrix<double, 7, 1> error;
        Eigen::Matrix<double, 7, 1> deviation;
        error << imu->rotation - flight.rig.rotation, imu->delay - flight.rig.delay, imu->bias;
        deviation << imu->rotation_deviation, imu->delay_deviation, imu->bias_deviation;
        squares += error.cwiseQuotient(deviation).cwiseAbs2() / kFlights;
      }
      EXPECT_LT(squares.maxCoeff(), 2.0) << squares.transpose();
      EXPECT_GT(squares.head<4>().minCoeff(), 0.03) << squares.transpose();
    }
  }
}

TEST(Mounting, UnobservableErrorsAreNotReported) {
  const Turns still = [](double) { return Eigen::Vector3d::Zero(); };
  const Turns steady = [](double t) { return Eigen::Vector3d(0.5 * t, 0.0, 0.0); };
  const Turns rolls = [](double t) { return Eigen::Vector3d(0.0, 0.0, 0.15 * std::sin(t)); };
  for (const Gives gives : {Gives::turns, Gives::directions}) {
    for (const double speed : {0.0, 2.5}) {
      Flight flight(gives);
      flight.turns = still;
      flight.speed = speed;
      const auto imu = flight.after(120.0);
      if (!imu) continue;
      EXPECT_TRUE(std::isinf(imu->rotation_deviation.minCoeff())) << describe(*imu);
      EXPECT_TRUE(std::isinf(imu->delay_deviation)) << describe(*imu);
      EXPECT_EQ(troubleOf(*imu), "");
    }
    Flight turning(gives);
    turning.turns = steady;
    turning.rig = {degrees(2.0, 2.0, 2.0), 0.05};
    const auto imu = turning.after(120.0);
    ASSERT_TRUE(imu);
    EXPECT_TRUE(std::isinf(imu->rotation_deviation.z())) << describe(*imu);
    EXPECT_TRUE(std::isinf(imu->delay_deviation)) << describe(*imu);
    Flight rolling(gives);
    rolling.turns = rolls;
    rolling.rig.rotation = degrees(2.0, 0.0, 0.0);
    const auto about_x = rolling.after(120.0);
    ASSERT_TRUE(about_x);
    EXPECT_TRUE(std::isinf(about_x->rotation_deviation.x())) << describe(*about_x);
    EXPECT_EQ(about_x->rotation.x(), 0.0);
    EXPECT_TRUE(std::isfinite(about_x->delay_deviation)) << describe(*about_x);
  }
}

TEST(Mounting, CorrectRigHasNoWarning) {
  for (const Gives gives : {Gives::turns, Gives::directions}) {
    for (unsigned seed = 1; seed <= 4; ++seed) {
      Flight flight(gives, seed);
      flight.image_noise = 1e-4 * seed;
      flight.tilt_noise = 0.5 * kDegree;
      for (int i = 0; i < 60; ++i) {
        const auto imu = flight.after(3.0);
        if (imu) {
          EXPECT_EQ(troubleOf(*imu), "") << "after " << 3 * (i + 1) << " s";
        }
      }
    }
  }
}

TEST(Mounting, FollowsAnImuThatIsMountedAnew) {
  for (const Gives gives : {Gives::turns, Gives::directions}) {
    Flight flight(gives);
    flight.after(60.0);
    flight.rig = {degrees(0.0, 2.0, 0.0), -0.015};
    expectFound(flight.after(600.0), flight.rig, 0.3, 0.002);
  }
}

// The mean of five minutes would hide the jump for minutes, and its deviation would be too small.
TEST(Mounting, FollowsABiasThatJumps) {
  for (const double before : {20.0, 60.0, 300.0}) {
    for (const double jump : {0.5, 1.5, 5.0}) {
      SCOPED_TRACE(std::to_string(jump) + " degrees/s after " + std::to_string(before) + " s");
      Flight flight(Gives::turns);
      const auto steady = flight.after(before);
      ASSERT_TRUE(steady);
      if (before == 300.0) {
        EXPECT_LT(steady->bias_deviation.norm(), 0.1 * kDegree);
      }
      flight.rig.bias = degrees(0.0, 0.0, jump);
      const auto imu = flight.after(50.0);
      ASSERT_TRUE(imu);
      const std::string text = describe(*imu);
      EXPECT_LT((imu->bias - flight.rig.bias).norm(), 0.25 * kDegree) << text;
      for (int i = 0; i < 3; ++i) {
        EXPECT_LT(std::abs(imu->bias(i) - flight.rig.bias(i)), 4.0 * imu->bias_deviation(i))
            << text;
        EXPECT_LT(std::abs(imu->rotation(i)), 4.0 * imu->rotation_deviation(i)) << text;
      }
      EXPECT_LT(std::abs(imu->delay), 4.0 * imu->delay_deviation) << text;
      EXPECT_LT(std::abs(imu->scale_error), 4.0 * imu->scale_error_deviation) << text;
    }
  }
}

// The age of a reading is no delay, and what is learned before a gap stays.
TEST(Mounting, LearnsFromOldReadingsAndAcrossGaps) {
  for (const Gives gives : {Gives::turns, Gives::directions}) {
    Flight flight(gives);
    flight.rig = {degrees(0.0, 0.0, 1.5), -0.015};
    flight.age = 0.008;
    flight.gap_every = 100;
    expectFound(flight.after(120.0), flight.rig, 0.3, 0.003);
  }
}

TEST(Mounting, LearnsThoughSomeTurnsAreMissing) {
  Flight flight(Gives::turns);
  flight.rig = {degrees(0.0, 0.0, 1.5), 0.02, degrees(0.0, 1.0, 0.0)};
  for (int i = 0; i < 3600; ++i) {
    GroundFrame frame = flight.next();
    if (i % 100 == 0) frame.turn.reset();
    flight.add(frame);
  }
  const auto imu = flight.step().imu;
  ASSERT_TRUE(imu);
  EXPECT_LT((imu->rotation - flight.rig.rotation).norm(), 0.3 * kDegree) << describe(*imu);
  EXPECT_LT((imu->bias - flight.rig.bias).norm(), 0.15 * kDegree) << describe(*imu);
  // A gyroscope that is gone for good leaves the orientation.
  std::optional<ImuMounting> by_orientation;
  for (int i = 0; i < 1800; ++i) {
    GroundFrame frame = flight.next();
    frame.turn.reset();
    by_orientation = flight.add(frame).imu;
  }
  ASSERT_TRUE(by_orientation);
  EXPECT_NEAR(by_orientation->delay, flight.rig.delay, 0.003) << describe(*by_orientation);
  EXPECT_TRUE(std::isinf(by_orientation->bias_deviation.y())) << describe(*by_orientation);
}

TEST(Mounting, UnrelatedDirectionGivesNoMounting) {
  Flight flight(Gives::directions);
  flight.is_of_imu = false;
  EXPECT_FALSE(flight.after(60.0));
}

TEST(Mounting, AnImuInOtherAxesIsNotCalledALittleOff) {
  Flight flight(Gives::turns);
  flight.rig.rotation = degrees(0.0, 0.0, 90.0);
  const auto imu = flight.after(60.0);
  EXPECT_EQ(imu ? troubleOf(*imu) : "", "");
}

TEST(Mounting, ChangesNoEstimate) {
  Flight with(Gives::directions);
  Flight without(Gives::directions);
  with.rig = without.rig = {degrees(2.0, 0.0, 0.0), 0.03};
  without.is_of_imu = false;
  for (int i = 0; i < 600; ++i) {
    const GroundEstimate a = with.step();
    const GroundEstimate b = without.step();
    ASSERT_EQ(a.base_to_odometry.matrix(), b.base_to_odometry.matrix()) << i;
    ASSERT_EQ(a.twist, b.twist) << i;
    ASSERT_EQ(a.twist_covariance, b.twist_covariance) << i;
  }
}

TEST(Mounting, AllocatesNothingInTheSteadyState) {
  for (const Gives gives : {Gives::turns, Gives::directions}) {
    Flight flight(gives);
    flight.after(10.0);
    std::vector<GroundFrame> frames;
    for (int i = 0; i < 60; ++i) frames.push_back(flight.next());
    const test::AllocationCounter counter;
    for (const GroundFrame& frame : frames) flight.add(frame);
    EXPECT_EQ(counter.count(), 0U);
  }
}

TEST(Mounting, TextsHaveTheDigitsThatAreKnown) {
  ImuMounting imu;
  imu.rotation = degrees(0.96, 0.1, -2.0);
  imu.rotation_deviation = degrees(0.1, 0.04, std::numeric_limits<double>::infinity());
  imu.rotation.z() = 0.0;
  imu.delay = -0.0204;
  imu.delay_deviation = 0.0012;
  imu.bias = degrees(0.0, 1.25, 0.0);
  imu.bias_deviation = degrees(0.02, 0.02, 0.02);
  imu.scale_error = -0.031;
  imu.scale_error_deviation = 0.004;
  EXPECT_EQ(describe(imu),
            "mounted 1.0 +- 0.1 degrees off about x, 0.10 +- 0.04 degrees off about y; stamps 20 "
            "+- 1 ms early; angular velocity 0.00 +- 0.02 degrees/s off about x, 1.25 +- 0.02 "
            "degrees/s off about y, 0.00 +- 0.02 degrees/s off about z; its scale 3.1 +- 0.4 % too "
            "small");
  EXPECT_EQ(troubleOf(imu),
            "the Imu seems to be mounted 1.0 +- 0.1 degrees off about x; the Imu's stamps seem 20 "
            "+- 1 ms early; the Imu's angular velocity seems 1.25 +- 0.02 degrees/s off about y; "
            "the scale of the Imu's angular velocity seems 3.1 +- 0.4 % too small");
  imu.rotation_deviation.x() = 0.3 * kDegree;  // not certain
  imu.delay = 0.003;                           // does not matter
  imu.bias.y() = 0.2 * kDegree;
  imu.scale_error = 0.01;
  EXPECT_EQ(troubleOf(imu), "");
}

}  // namespace
}  // namespace ktgp_orb

namespace ktgp_orb::motion {
namespace {

constexpr double kSeconds = 1.0 / 30.0;
constexpr double kHeight = 5.0;  // m

/// Twists of a smooth motion between poses with independent errors. The covariance that is said
/// correlates turning and velocity, as a camera that looks down does.
class Twists {
 public:
  explicit Twists(unsigned seed) : random_(seed) {
    Matrix6 mixing = Matrix6::Identity();
    mixing(0, 4) = kHeight;
    mixing(1, 3) = -kHeight;
    Vector6 variance;  // variance of a pose
    variance << 1e-4, 1e-4, 2e-4, 1e-5, 1e-5, 1e-5;
    mixing_ = mixing;
    covariance = 2.0 * mixing * variance.asDiagonal() * mixing.transpose();
    deviation_ = variance.cwiseSqrt();
  }

  Matrix6 covariance;
  Vector6 shares = Vector6::Ones();  // true variances over the stated ones
  double roughness = 0.0;
  double speed = 1.0;

  Vector6 next() {
    Vector6 error;
    for (int i = 0; i < 6; ++i) error(i) = std::sqrt(shares(i)) * deviation_(i) * normal_(random_);
    error = mixing_ * error;
    const double t = kSeconds * frame_++;
    Vector6 twist;
    twist << std::sin(t), std::cos(0.7 * t), 0.3, 0.2 * std::sin(1.3 * t), 0.1, 0.5 * std::cos(t);
    twist *= speed;
    for (int i = 0; i < 6; ++i) twist(i) += roughness * normal_(random_);
    twist += error - last_;
    last_ = error;
    return twist;
  }

 private:
  std::mt19937 random_;
  std::normal_distribution<double> normal_;
  Matrix6 mixing_;
  Vector6 deviation_;
  Vector6 last_ = Vector6::Zero();
  int frame_ = 0;
};

/// The first twist of a keyframe is said to be precise, so that it limits no later share.
void addFirst(const Vector6& twist, const Twists& twists, TwistNoise& noise) {
  noise.add(twist, 1e-3 * twists.covariance, kSeconds, kHeight);
}

TwistNoise learned(Twists& twists, int frames) {
  TwistNoise noise;
  addFirst(twists.next(), twists, noise);
  for (int i = 1; i < frames; ++i) noise.add(twists.next(), twists.covariance, kSeconds, kHeight);
  return noise;
}

/// Largest and smallest ratio of the variances, over all directions.
void expectShares(const Matrix6& scaled, const Matrix6& covariance, const Vector6& shares) {
  const Matrix6 inverse = Matrix6(covariance.reverse().llt().matrixL()).inverse();
  const Vector6 found =
      (inverse * Matrix6(scaled.reverse()) * inverse.transpose()).diagonal().reverse();
  for (int i = 0; i < 6; ++i) {
    EXPECT_GT(found(i), 0.8 * shares(i)) << i;
    EXPECT_LT(found(i), 1.9 * shares(i)) << i;  // the larger of the means of 30 and of 300
  }
}

TEST(TwistNoise, FindsTheShareOfEachKind) {
  Twists twists(1);
  twists.shares << 0.1, 0.1, 0.25, 0.4, 0.4, 0.4;  // shift, approach, turning
  const TwistNoise noise = learned(twists, 1000);
  expectShares(noise.scaled(twists.covariance), twists.covariance, twists.shares);
}

TEST(TwistNoise, FollowsMoreNoiseWithinASecondAndLessNoiseSlowly) {
  Twists twists(2);
  twists.shares.setConstant(0.1);
  TwistNoise noise = learned(twists, 600);
  twists.shares.setConstant(0.6);
  for (int i = 0; i < 60; ++i) noise.add(twists.next(), twists.covariance, kSeconds, kHeight);
  EXPECT_GT(noise.scaled(twists.covariance)(3, 3), 0.4 * twists.covariance(3, 3));
  for (int i = 0; i < 600; ++i) noise.add(twists.next(), twists.covariance, kSeconds, kHeight);
  twists.shares.setConstant(0.1);
  for (int i = 0; i < 60; ++i) noise.add(twists.next(), twists.covariance, kSeconds, kHeight);
  EXPECT_GT(noise.scaled(twists.covariance)(3, 3), 0.4 * twists.covariance(3, 3));
}

TEST(TwistNoise, NoiseIsBoundedByCovarianceAndNotReducedByRoughMotion) {
  for (const auto& [share, roughness] : {std::pair(9.0, 0.0), std::pair(0.1, 0.5)}) {
    Twists twists(3);
    twists.shares.setConstant(share);
    twists.roughness = roughness;
    const TwistNoise noise = learned(twists, 600);
    EXPECT_LT((noise.scaled(twists.covariance) - twists.covariance).norm(),
              1e-9 * twists.covariance.norm());
  }
}

TEST(TwistNoise, OneOutlierHasABoundedEffect) {
  Twists twists(5);
  twists.shares.setConstant(0.1);
  TwistNoise noise = learned(twists, 600);
  noise.add(twists.next() + Vector6::Constant(100.0), twists.covariance, kSeconds, kHeight);
  for (int i = 0; i < 150; ++i) noise.add(twists.next(), twists.covariance, kSeconds, kHeight);
  EXPECT_LT(noise.scaled(twists.covariance)(3, 3), 0.5 * twists.covariance(3, 3));
}

TEST(TwistNoise, TheFirstTwistOfAKeyframeHasTheWholeCovariance) {
  Twists twists(6);
  twists.shares.setConstant(0.1);
  TwistNoise noise = learned(twists, 600);
  EXPECT_LT(noise.scaled(twists.covariance)(3, 3), 0.3 * twists.covariance(3, 3));
  noise.beginKeyframe();
  addFirst(100.0 * twists.next(), twists, noise);
  EXPECT_EQ(noise.scaled(twists.covariance), twists.covariance);
  for (int i = 0; i < 5; ++i) {  // and it does not count as noise
    noise.add(twists.next(), twists.covariance, kSeconds, kHeight);
    EXPECT_LT(noise.scaled(twists.covariance)(3, 3), 0.3 * twists.covariance(3, 3));
  }
}

TEST(TwistNoise, NoTwistIsSurerThanTheFirstOfItsKeyframe) {
  Twists twists(10);
  twists.shares.setConstant(0.1);
  TwistNoise noise = learned(twists, 600);
  for (const double first : {0.08, 0.2, 0.8}) {  // of the covariance of the later twists
    noise.beginKeyframe();
    noise.add(twists.next(), first * twists.covariance, kSeconds, kHeight);
    noise.add(twists.next(), twists.covariance, kSeconds, kHeight);
    const double share = noise.scaled(twists.covariance)(3, 3) / twists.covariance(3, 3);
    EXPECT_NEAR(share, std::min(std::max(first / kOfFrame, 0.1), 1.0), 0.05) << first;
  }
}

TEST(TwistNoise, LearnsNothingFromAStillPictureOrUnequalTimes) {
  Twists still(7);
  still.speed = 0.0;
  still.shares.setConstant(1e-6);
  EXPECT_EQ(learned(still, 600).scaled(still.covariance)(3, 3), still.covariance(3, 3));
  Twists twists(8);
  twists.shares.setConstant(0.1);
  TwistNoise noise;
  for (int i = 0; i < 600; ++i) {
    noise.add(twists.next(), twists.covariance, (i % 4 == 0 ? 2.0 : 1.0) * kSeconds, kHeight);
  }
  EXPECT_NEAR(noise.scaled(twists.covariance)(3, 3) / twists.covariance(3, 3), 1.0, 1e-9);
}

TEST(TwistNoise, RoundingCovarianceStays) {
  Twists twists(9);
  twists.shares.setConstant(0.1);
  TwistNoise noise = learned(twists, 600);
  Matrix6 indefinite = twists.covariance;
  indefinite(4, 4) *= -1e-3;
  EXPECT_EQ(noise.scaled(indefinite), indefinite);
  for (int i = 0; i < 60; ++i) noise.add(twists.next(), indefinite, kSeconds, kHeight);
  EXPECT_LT(noise.scaled(twists.covariance)(3, 3), 0.3 * twists.covariance(3, 3));
}

TEST(Relief, SeenWhereNearlyAllPicturesDeviate) {
  Relief flat;
  for (int i = 0; i < 300; ++i) flat.add(i % 5 < 3 ? 1e-3 : 0.0, 0.3);  // by chance
  EXPECT_FALSE(flat.isSeen());
  HeightReading height;
  height.metres = 10.0;
  height.deviation = 0.1;
  DownReading down;
  down.deviation = 0.01;
  EXPECT_EQ(flat.widened(height).deviation, 0.1);
  EXPECT_EQ(flat.widened(down).deviation, 0.01);
  Relief hilly;
  for (int i = 0; i < 300; ++i) hilly.add(1e-3, 0.2);  // 0.5 % of the height
  EXPECT_TRUE(hilly.isSeen());
  EXPECT_NEAR(hilly.widened(height).deviation, std::hypot(0.1, 2.0 * 0.005 * 10.0), 1e-3);
  EXPECT_NEAR(hilly.widened(down).deviation, std::hypot(0.01, 6.0 * 0.005), 1e-4);
  for (int i = 0; i < 300; ++i) hilly.add(0.0, 0.01);  // too near to the keyframe to show any
  EXPECT_TRUE(hilly.isSeen());
}

}  // namespace
}  // namespace ktgp_orb::motion
