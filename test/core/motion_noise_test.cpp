// What the motion learns from the frames: how large the noise of a twist is, and whether the ground
// is flat.

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <utility>

#include "motion/noise.h"

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
    Vector6 variance;  // of a pose
    variance << 1e-4, 1e-4, 2e-4, 1e-5, 1e-5, 1e-5;
    mixing_ = mixing;
    covariance = 2.0 * mixing * variance.asDiagonal() * mixing.transpose();
    deviation_ = variance.cwiseSqrt();
  }

  Matrix6 covariance;
  Vector6 shares = Vector6::Ones();  // of the variances that the errors really have
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

TwistNoise learned(Twists& twists, int frames) {
  TwistNoise noise;
  for (int i = 0; i < frames; ++i) noise.add(twists.next(), twists.covariance, kSeconds, kHeight);
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

TEST(TwistNoise, IsNeverTakenForMoreThanTheCovarianceNorMadeSmallerByARoughMotion) {
  for (const auto& [share, roughness] : {std::pair(9.0, 0.0), std::pair(0.1, 0.5)}) {
    Twists twists(3);
    twists.shares.setConstant(share);
    twists.roughness = roughness;
    const TwistNoise noise = learned(twists, 600);
    EXPECT_LT((noise.scaled(twists.covariance) - twists.covariance).norm(),
              1e-9 * twists.covariance.norm());
  }
}

TEST(TwistNoise, OneOutlierCountsAsMuchAsItMay) {
  Twists twists(5);
  twists.shares.setConstant(0.1);
  TwistNoise noise = learned(twists, 600);
  noise.add(twists.next() + Vector6::Constant(100.0), twists.covariance, kSeconds, kHeight);
  for (int i = 0; i < 150; ++i) noise.add(twists.next(), twists.covariance, kSeconds, kHeight);
  EXPECT_LT(noise.scaled(twists.covariance)(3, 3), 0.5 * twists.covariance(3, 3));
}

TEST(TwistNoise, TheFirstTwistOfAKeyframeHasAllOfIt) {
  Twists twists(6);
  twists.shares.setConstant(0.1);
  TwistNoise noise = learned(twists, 600);
  EXPECT_LT(noise.scaled(twists.covariance)(3, 3), 0.3 * twists.covariance(3, 3));
  noise.beginKeyframe();
  noise.add(100.0 * twists.next(), twists.covariance, kSeconds, kHeight);
  EXPECT_EQ(noise.scaled(twists.covariance), twists.covariance);
  for (int i = 0; i < 5; ++i) {  // and it does not count as noise
    noise.add(twists.next(), twists.covariance, kSeconds, kHeight);
    EXPECT_LT(noise.scaled(twists.covariance)(3, 3), 0.3 * twists.covariance(3, 3));
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

TEST(TwistNoise, ACovarianceThatIsNothingButRoundingStays) {
  Twists twists(9);
  twists.shares.setConstant(0.1);
  TwistNoise noise = learned(twists, 600);
  Matrix6 indefinite = twists.covariance;
  indefinite(4, 4) *= -1e-3;
  EXPECT_EQ(noise.scaled(indefinite), indefinite);
  for (int i = 0; i < 60; ++i) noise.add(twists.next(), indefinite, kSeconds, kHeight);
  EXPECT_LT(noise.scaled(twists.covariance)(3, 3), 0.3 * twists.covariance(3, 3));
}

TEST(Relief, IsSeenWhereNearlyAllPicturesDeviate) {
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
