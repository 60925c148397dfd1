// Metric motion against the truth, against numeric derivatives and in Monte Carlo.

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <functional>
#include <opencv2/core.hpp>
#include <random>
#include <stdexcept>
#include <string>

#include "allocation_counter.h"
#include "ground_flight.h"
#include "ktgp_orb/prosac_homography.h"
#include "refusal.h"

namespace ktgp_orb {
namespace {

using motion::CameraPose;
using motion::Matrix8;
using motion::Vector6;
using motion::Vector8;
using test::camera;
using test::downward;
using test::kDegree;
using test::kRate;
using test::mounted;
using test::optionsWith;
using test::stampOf;

/// A smooth motion of the base at about four metres.
CameraPose truthAt(int frame, const Pose3& camera_to_base) {
  const double t = frame / kRate;
  const Eigen::Vector3d position(2.5 * t, 1.5 * std::sin(0.7 * t), 4.0 + 0.5 * std::sin(0.5 * t));
  const Eigen::Vector3d angles(0.5 * std::sin(0.9 * t), 0.12 * std::sin(1.3 * t),
                               0.1 * std::sin(1.1 * t));
  return test::cameraAt(position, angles, camera_to_base);
}

CameraPose baseOf(const CameraPose& pose, const Pose3& camera_to_base) {
  const Pose3 inverse = camera_to_base.inverse();
  return {pose.axes * inverse.linear(), pose.position + pose.axes * inverse.translation()};
}

/// The homography between the images of two poses, px.
Eigen::Matrix3d between(const CameraPose& from, const CameraPose& to) {
  return camera() * motion::imageFromGround(to) * motion::imageFromGround(from).inverse() *
         camera().inverse();
}

/// A flight with a new keyframe every ten frames, and what is known of it.
class Flight : public test::GroundPictures {
 public:
  Flight(const Pose3& camera_to_base, double image_noise, unsigned seed = 1)
      : GroundPictures(image_noise, seed),
        ground(optionsWith(camera_to_base)),
        camera_to_base_(camera_to_base) {}
  /// With 1 % noise of the ranges, and noise of the tilt.
  static Flight noisy(const Pose3& camera_to_base, double image_noise, unsigned seed = 1,
                      double tilt_noise = 0.5 * kDegree) {
    Flight flight(camera_to_base, image_noise, seed);
    flight.range_noise = 0.01;
    flight.tilt_noise = tilt_noise;
    return flight;
  }

  GroundMotion ground;
  double range_noise = 0.0;  // share
  double tilt_noise = 0.0;   // rad
  bool gives_height = true;
  bool gives_down = true;
  double length_factor = 1.0;  // factor of the ranges
  double scale = 1.0;          // factor of all lengths
  int gust_from = 1 << 30;     // frame: from here on 10 m/s more
  bool shuttles = false;       // level at two metres, there and back within sight of one keyframe

  CameraPose truth(int frame) const {
    if (!shuttles) {
      CameraPose pose = truthAt(frame, camera_to_base_);
      pose.position.y() += 10.0 / kRate * std::max(0, frame - gust_from + 1);
      pose.position *= scale;
      return pose;
    }
    const double way = 0.3 * (1.0 - std::cos(6.0 * kDegree * frame));
    return {camera_to_base_.linear(), Eigen::Vector3d(way, 0.6 * way, 2.0)};
  }
  CameraPose base(int frame) const { return baseOf(truth(frame), camera_to_base_); }
  Vector6 twist(int frame) const {
    return kRate * motion::constantTwist(base(frame - 1), base(frame));
  }
  Eigen::Vector3d velocityError(int frame, const GroundEstimate& estimate) const {
    return (estimate.twist - twist(frame)).head<3>();
  }
  /// Camera of `frame` -> of the one before.
  Eigen::Matrix3d turn(int frame) const {
    return truth(frame - 1).axes.transpose() * truth(frame).axes;
  }

  GroundFrame next() {
    const CameraPose pose = truth(frame_++);
    GroundFrame result = seenFrom(pose);
    if (gives_height) result.height = height(pose);
    if (gives_down) result.down = down(pose);
    return result;
  }
  const GroundEstimate& step() { return ground.add(next()); }
  /// With other readings.
  template <typename Change>
  const GroundEstimate& step(const Change& change) {
    GroundFrame frame = next();
    change(frame);
    return ground.add(frame);
  }
  /// Calls `visit` with each velocity from frame 150 to 450, which has a while to settle, and with
  /// its error.
  template <typename Visit>
  void forEachVelocity(const Visit& visit) {
    for (int i = 0; i < 450; ++i) {
      const GroundEstimate& estimate = step();
      if (i >= 150 && estimate.hasTwist()) visit(estimate, velocityError(i, estimate));
    }
  }
  const GroundEstimate& steps(int count) {
    for (int i = 1; i < count; ++i) step();
    return step();
  }

 private:
  HeightReading height(const CameraPose& pose) {
    HeightReading reading;
    reading.metres = length_factor * pose.position.z() * (1.0 + range_noise * normal());
    reading.deviation = range_noise * pose.position.z();
    return reading;
  }

  DownReading down(const CameraPose& pose) {
    DownReading reading;
    reading.direction = motion::rotationAbout(tilt_noise * shake()) * -pose.axes.row(2).transpose();
    reading.direction.normalize();
    reading.deviation = tilt_noise;
    return reading;
  }

  Pose3 camera_to_base_;
  int frame_ = 0;
};

/// The message about the normal, by that angle.
void turn(GroundFrame& frame, double angle) {
  frame.down->direction = motion::rotationAbout({angle, 0.0, 0.0}) * frame.down->direction;
}

void turnAway(GroundFrame& frame) {
  frame.down->direction = -frame.down->direction;
}

/// Base of a frame in the odometry frame, which starts at frame `first`.
CameraPose inOdometry(const CameraPose& base, const CameraPose& first) {
  const double yaw = std::atan2(first.axes(1, 0), first.axes(0, 0));
  const Eigen::Matrix3d turn = motion::rotationAbout(-yaw * Eigen::Vector3d::UnitZ());
  Eigen::Vector3d origin = first.position;
  origin.z() = 0.0;
  return {turn * base.axes, turn * (base.position - origin)};
}

Vector6 poseError(const GroundEstimate& estimate, const CameraPose& wanted) {
  Vector6 error;
  error << estimate.base_to_odometry.translation() - wanted.position,
      motion::turnOf(estimate.base_to_odometry.linear() * wanted.axes.transpose());
  return error;
}

TEST(GroundMotion, FollowsAnExactFlightOfAMountedCamera) {
  Flight flight(mounted(), 1e-8);
  for (int i = 0; i < 300; ++i) {
    const GroundEstimate& estimate = flight.step();
    if (i == 0) {
      EXPECT_EQ(estimate.status, GroundStatus::no_homography);
      continue;
    }
    ASSERT_EQ(estimate.status, i == 1 ? GroundStatus::started : GroundStatus::ok) << i;
    const CameraPose wanted = inOdometry(flight.base(i), flight.base(1));
    EXPECT_LT(poseError(estimate, wanted).norm(), 1e-4) << i;
    if (i == 1) continue;
    const Vector6 twist = flight.twist(i);
    EXPECT_LT((estimate.twist - twist).norm(), 1e-4) << i;
  }
}

template <int kSize, typename Function>
Eigen::MatrixXd numericSlope(const Function& function) {
  constexpr double kStep = 1e-6;
  Eigen::MatrixXd slope(function(Eigen::Matrix<double, kSize, 1>::Zero().eval()).size(), kSize);
  for (int i = 0; i < kSize; ++i) {
    const Eigen::Matrix<double, kSize, 1> step = kStep * Eigen::Matrix<double, kSize, 1>::Unit(i);
    slope.col(i) =
        (function(step) - function(Eigen::Matrix<double, kSize, 1>(-step))) / (2.0 * kStep);
  }
  return slope;
}

TEST(GroundMotion, DerivativesMatchNumericOnes) {
  const CameraPose pose = truthAt(40, mounted());
  const CameraPose before = truthAt(37, mounted());
  const Eigen::Matrix3d map = 0.37 * motion::imageFromGround(truthAt(33, mounted())).inverse();
  const Eigen::Matrix3d h = motion::imageFromGround(pose) * map;
  const auto matrixOf = [](const Vector8& e) {
    Eigen::Matrix3d m = Eigen::Matrix3d::Identity();
    for (int i = 0; i < 8; ++i) m(i / 3, i % 3) += e(i);
    return m;
  };
  EXPECT_LT((motion::byPose(h, map, pose) - numericSlope<6>([&](const Vector6& step) {
               return motion::entriesOf(motion::imageFromGround(moved(pose, step)) * map);
             })).norm(),
            1e-7);
  EXPECT_LT((motion::byMap(h) - numericSlope<8>([&](const Vector8& e) {
               return motion::entriesOf(h * matrixOf(e));
             })).norm(),
            1e-7);
  EXPECT_LT((motion::byMap(h) * motion::mapFromEntries(h) - Matrix8::Identity()).norm(), 1e-9);

  HeightReading height;
  height.metres = 4.0;
  height.beam_origin << 0.1, -0.2, 0.05;
  height.beam_direction = Eigen::Vector3d(0.1, 0.2, 1.0).normalized();
  EXPECT_LT((rowsOf(height, pose, 0.0).slope + numericSlope<6>([&](const Vector6& step) {
               return rowsOf(height, moved(pose, step), 0.0).residual;
             })).norm(),
            1e-7);
  const DownReading down{Eigen::Vector3d(0.1, 0.1, 0.9).normalized(), 0.01};
  EXPECT_LT((rowsOf(down, pose).slope + numericSlope<6>([&](const Vector6& step) {
               return rowsOf(down, moved(pose, step)).residual;
             })).norm(),
            1e-7);
  // A reading from before the image, while the camera rises: along the beam that is more.
  height.age = 0.1;
  const double sink = -pose.axes.row(2).dot(height.beam_direction);
  EXPECT_LT(sink, 0.98);
  HeightReading at_image = height;
  at_image.age = 0.0;
  EXPECT_NEAR(rowsOf(height, pose, 2.0).residual(0) - rowsOf(at_image, pose, 2.0).residual(0),
              0.2 / sink, 1e-12);
  TurnReading turn;
  turn.rotation = before.axes.transpose() * pose.axes;
  EXPECT_LT((rowsOf(turn, pose, before).slope + numericSlope<6>([&](const Vector6& step) {
               return rowsOf(turn, moved(pose, step), before).residual;
             })).norm(),
            1e-7);
  EXPECT_LT((rowsOf(turn, pose, before).slope_before + numericSlope<6>([&](const Vector6& step) {
               return rowsOf(turn, pose, moved(before, step)).residual;
             })).norm(),
            1e-7);
}

TEST(GroundMotion, TheRotationBetweenTwoDirectionsIsTheSmallest) {
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  const auto direction = [&] {
    return Eigen::Vector3d(normal(random), normal(random), normal(random)).normalized();
  };
  const auto check = [](const Eigen::Vector3d& from, const Eigen::Vector3d& to, double angle,
                        double rounding) {
    const Eigen::Matrix3d turn = motion::rotationBetween(from, to);
    ASSERT_LT((turn.transpose() * turn - Eigen::Matrix3d::Identity()).norm(), 1e-14);
    ASSERT_GT(turn.determinant(), 0.0);
    ASSERT_LT((turn * from - to).norm(), rounding) << from.dot(to);
    ASSERT_NEAR(motion::turnOf(turn).norm(), angle, 1e-7);
  };
  for (int i = 0; i < 1000; ++i) {
    const Eigen::Vector3d from = direction();
    const Eigen::Vector3d to = direction();
    check(from, to, std::acos(from.dot(to)), 1e-12);
    ASSERT_EQ(motion::rotationBetween(from, from), Eigen::Matrix3d::Identity());
    for (double distance = 1e-17; distance < 1e-7; distance *= 10.0) {
      const Eigen::Vector3d near = (from + distance * to).normalized();
      check(from, near, (near - from).norm(), 1e-14);
      check(from, -near, EIGEN_PI, 1e-7);
    }
  }
}

TEST(GroundMotion, PixelsAndImageUnitsHaveTheSameCovariance) {
  Flight flight(mounted(), 1e-4);
  flight.next();
  GroundFrame frame;
  for (int i = 0; i < 7; ++i) frame = flight.next();
  const motion::ImageMotion image =
      motion::inImageUnits(frame.answer->homography, frame.answer->covariance, camera());
  const Eigen::MatrixXd slope = numericSlope<8>([&](const Vector8& e) {
    Eigen::Matrix3d h = frame.answer->homography;
    for (int i = 0; i < 8; ++i) h(i / 3, i % 3) += e(i);
    return motion::entriesOf(camera().inverse() * h * camera());
  });
  Matrix8 expected = slope * frame.answer->covariance * slope.transpose();
  expected.diagonal().array() += 1e-12;  // at least
  EXPECT_LT((image.covariance - expected).norm(), 1e-6 * expected.norm());
}

TEST(GroundMotion, CovariancesHoldInMonteCarlo) {
  test::Normalised twists, poses;
  constexpr int kFlights = 150;
  constexpr int kFrames = 150;
  for (unsigned seed = 1; seed <= kFlights; ++seed) {
    Flight flight = Flight::noisy(mounted(), 3e-5, seed);
    for (int i = 0; i < kFrames; ++i) {
      const GroundEstimate& estimate = flight.step();
      if (estimate.hasTwist()) {
        const Eigen::Vector3d error = flight.velocityError(i, estimate);
        twists.add(error, estimate.twist_covariance);
      }
      if (i == kFrames - 1) {
        const Vector6 error = poseError(estimate, inOdometry(flight.base(i), flight.base(1)));
        poses.add(error, estimate.pose_covariance);
      }
    }
  }
  EXPECT_GT(twists.mean(), 2.0);
  EXPECT_LT(twists.mean(), 4.0);
  EXPECT_GE(twists.within(16.27), 0.98);
  EXPECT_GT(poses.mean(), 4.0);  // 6 are expected
  EXPECT_LT(poses.mean(), 9.0);
}

/// What is said of later frames of a keyframe has errors that two successive images share. The
/// velocity does not have them, but over relief they may be errors of the plane.
TEST(GroundMotion, TheCovarianceOfTheVelocityFollowsItsNoiseButNotOverRelief) {
  for (const double plane_deviation : {0.0, 0.2}) {
    test::Normalised twists, second, late;
    for (unsigned seed = 1; seed <= 20; ++seed) {
      Flight flight = Flight::noisy(downward(), 3e-5, seed);
      flight.lasting = 0.9;
      flight.plane_deviation = plane_deviation;
      int i = 150;
      flight.forEachVelocity([&](const GroundEstimate& estimate, const Eigen::Vector3d& error) {
        const int age = i++ % 10;  // each tenth frame is a keyframe
        twists.add(error, estimate.twist_covariance);
        if (age == 2) second.add(error, estimate.twist_covariance);
        if (age >= 7) late.add(error, estimate.twist_covariance);
      });
    }
    // Three degrees of freedom.
    EXPECT_GT(twists.mean(), plane_deviation > 0.0 ? 0.0 : 1.5);
    EXPECT_LT(twists.mean(), plane_deviation > 0.0 ? 1.4 : 4.0);
    EXPECT_LT(late.mean(), plane_deviation > 0.0 ? 1.0 : 4.0);
    EXPECT_LT(second.mean(), 4.0);
    EXPECT_GE(second.within(16.27), 0.98);
  }
}

/// Where the pictures tell it worse than an acceleration changes it from frame to frame; else it is
/// that of the pictures.
TEST(GroundMotion, UncertainVelocityFollowsTheLastOne) {
  for (const double image_noise : {1e-4, 1e-3}) {
    double squares[2] = {};
    test::Normalised normalised[2];
    for (const bool follows : {false, true}) {
      for (unsigned seed = 1; seed <= 5; ++seed) {
        Flight flight = Flight::noisy(downward(), image_noise, seed);
        GroundMotionOptions options = flight.ground.options();
        if (!follows) options.acceleration = 1e6;
        flight.ground.setOptions(options);
        flight.forEachVelocity([&](const GroundEstimate& estimate, const Eigen::Vector3d& error) {
          squares[follows ? 1 : 0] += error.squaredNorm();
          normalised[follows ? 1 : 0].add(error, estimate.twist_covariance);
        });
      }
    }
    const double ratio = std::sqrt(squares[1] / squares[0]);
    EXPECT_LT(ratio, image_noise > 5e-4 ? 0.55 : 1.0);  // 0.45
    EXPECT_GT(ratio, image_noise > 5e-4 ? 0.0 : 0.95);
    EXPECT_EQ(normalised[1].count(), normalised[0].count());
    EXPECT_LT(normalised[1].mean(), normalised[0].mean());
    EXPECT_GT(normalised[1].mean(), 1.0) << "three are expected";
  }
}

/// Over relief a misfit is no noise. Homographies that claim a fiftieth of their variance still
/// outweigh the noisy readings; over flat ground the misfit would correct the claim.
TEST(GroundMotion, OverReliefAMisfitDoesNotMakeTheHomographiesCountLess) {
  double squares[2] = {};
  for (const double claimed : {1.0, 0.02}) {
    for (unsigned seed = 1; seed <= 5; ++seed) {
      Flight flight = Flight::noisy(downward(), 3e-4, seed);
      flight.claimed = claimed;
      flight.plane_deviation = 0.3;
      flight.forEachVelocity([&](const GroundEstimate&, const Eigen::Vector3d& error) {
        squares[claimed < 1.0 ? 1 : 0] += error.squaredNorm();
      });
    }
  }
  EXPECT_LT(std::sqrt(squares[1] / squares[0]), 0.9);
}

TEST(GroundMotion, OverReliefReadingsCountLess) {
  for (const bool relief : {false, true}) {
    Flight flight(downward(), 3e-5);
    flight.range_noise = 0.002;
    flight.tilt_noise = 0.1 * kDegree;
    flight.plane_deviation = relief ? 2.0 : 0.0;
    flight.steps(200);
    const GroundEstimate& estimate = flight.step([](GroundFrame& frame) {
      frame.height->metres *= 1.03;
      turn(frame, 0.03);
    });
    EXPECT_EQ(estimate.height_used, relief);
    EXPECT_EQ(estimate.down_used, relief);
  }
}

/// Readings of the tilt that contradict again and again make it uncertain. Over relief they
/// contradict the slope that a keyframe sees, all together, and count once.
TEST(GroundMotion, OverReliefReadingsContradictAKeyframeOnce) {
  for (const bool relief : {false, true}) {
    Flight flight = Flight::noisy(downward(), 3e-5, 1, 0.1 * kDegree);
    flight.plane_deviation = relief ? 0.3 : 0.0;
    EXPECT_LT(flight.steps(301).tilt_deviation, 0.001);
    int uncertain = 0;
    for (int i = 0; i < 30; ++i) {  // three keyframes
      if (flight.step([](GroundFrame& f) { turn(f, 0.2); }).tilt_deviation > 0.01) ++uncertain;
    }
    // A single one changes nothing: all frames but the first, or all keyframes but the first.
    EXPECT_EQ(uncertain, relief ? 2 : 29);
  }
}

/// All images are equally good, so no velocity from a keyframe is surer than the first one.
TEST(GroundMotion, NoVelocityFromAKeyframeIsSurerThanTheFirst) {
  Flight flight = Flight::noisy(downward(), 3e-5);
  flight.lasting = 0.9;
  double variances[10] = {};
  for (int i = 0; i < 600; ++i) {
    const GroundEstimate& estimate = flight.step();
    if (i >= 400) variances[i % 10] += estimate.twist_covariance.topLeftCorner<3, 3>().trace();
  }
  for (int age = 0; age < 10; ++age) {  // each tenth frame is a keyframe
    EXPECT_GT(variances[age], 0.7 * variances[1]) << age;
    EXPECT_LT(variances[age], 2.0 * variances[1]) << age;
  }
}

TEST(GroundMotion, WithoutReadingsTheSlopeOfTheGroundGetsUncertain) {
  Flight flight(downward(), 1e-7);
  flight.tilt_noise = 1e-5;
  GroundMotionOptions options = optionsWith(downward());
  options.ground_slope = 0.01;
  flight.ground = GroundMotion(options);
  flight.steps(30);
  flight.gives_down = false;
  double known = 0.0;
  for (int i = 0; i < 11; ++i) known = flight.step().tilt_deviation;
  double way = 0.0;
  for (int i = 41; i < 51; ++i) {
    way += (flight.truth(i).position - flight.truth(i - 1).position).norm();
    const GroundEstimate& estimate = flight.step();
    EXPECT_TRUE(i < 50 || estimate.tilt_deviation > known);
  }
  EXPECT_GT(way, 0.5);
}

TEST(GroundMotion, ExactReadingsKeepTheFilterDefinite) {
  for (unsigned seed = 1; seed <= 30; ++seed) {
    Flight flight(downward(), 1e-6, seed);
    flight.perspective = 10.0;
    for (int i = 0; i < 100; ++i) {
      const GroundEstimate& estimate = flight.step();
      if (i < 2) continue;
      ASSERT_EQ(estimate.status, GroundStatus::ok) << seed << " " << i;
      EXPECT_LT(flight.velocityError(i, estimate).norm(), 0.06) << seed << " " << i;
      for (const Covariance6& covariance : {estimate.pose_covariance, estimate.twist_covariance}) {
        ASSERT_GT(covariance.diagonal().minCoeff(), 0.0) << seed << " " << i;
      }
    }
  }
}

TEST(GroundMotion, StaysDefiniteWhileOneKeyframeLastsLong) {
  for (const double image_noise : {1e-5, 1e-6, 1e-7, 1e-9}) {  // the least is that of simulations
    Flight flight = Flight::noisy(downward(), image_noise);
    flight.shuttles = true;
    flight.keyframe_every = 100000;
    for (int i = 0; i < 1000; ++i) {
      const GroundEstimate& estimate = flight.step();
      if (i < 2) continue;
      ASSERT_EQ(estimate.status, GroundStatus::ok) << image_noise << " " << i;
      for (const Covariance6& covariance : {estimate.pose_covariance, estimate.twist_covariance}) {
        ASSERT_EQ(covariance.llt().info(), Eigen::Success) << image_noise << " " << i;
      }
    }
  }
}

TEST(GroundMotion, BeginsAnewAfterNumbersThatAreTooLarge) {
  Flight flight = Flight::noisy(downward(), 1e-5);
  GroundStatus last = GroundStatus::ok;
  int losses = 0;
  for (int i = 0; i < 100; ++i) {
    const GroundEstimate& estimate = flight.step([i](GroundFrame& frame) {
      if (i == 41) frame.answer->covariance *= 1e306;
    });
    if (estimate.status == GroundStatus::not_finite) ++losses;
    if (last == GroundStatus::not_finite) {
      EXPECT_EQ(estimate.status, GroundStatus::started);
      EXPECT_LT(estimate.base_to_odometry.translation().head<2>().norm(), 1e-9);
    }
    last = estimate.status;
    ASSERT_TRUE(i <= 70 || estimate.status == GroundStatus::ok) << i;
    ASSERT_TRUE(!estimate.hasPose() || estimate.pose_covariance.allFinite()) << i;
  }
  EXPECT_EQ(losses, 1);
  EXPECT_STREQ(toString(GroundStatus::not_finite), "not_finite");
}

TEST(GroundMotion, PreciseImagesAgreeWithACoarselyKnownTilt) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    Flight flight = Flight::noisy(downward(), 1e-6, seed, 2.0 * kDegree);
    for (int i = 0; i < 60; ++i) {
      const GroundStatus status = flight.step().status;
      ASSERT_TRUE(i < 2 || status == GroundStatus::ok) << seed << " " << i;
    }
  }
}

TEST(GroundMotion, GapGrowsCovariance) {
  Flight flight(mounted(), 3e-5);
  flight.tilt_noise = 1e-4;
  Covariance6 before = Covariance6::Zero();
  for (int i = 0; i < 200; ++i) {
    GroundFrame frame = flight.next();
    const bool missing = i >= 80 && i < 110;
    if (missing) frame.answer.reset();
    if (i == 110) frame.reference_stamp = stampOf(109);  // as the matcher, which begins anew there
    if (i == 110) frame.answer->homography = between(flight.truth(109), flight.truth(110));
    if (i > 110 && i <= 120) {
      frame.reference_stamp = stampOf(110);
      frame.answer->homography = between(flight.truth(110), flight.truth(i));
    }
    const GroundEstimate& estimate = flight.ground.add(frame);
    if (i == 79) before = estimate.pose_covariance;
    if (missing) {
      ASSERT_EQ(estimate.status, GroundStatus::no_homography);
      EXPECT_FALSE(estimate.hasPose());
    }
    if (i != 110) continue;
    ASSERT_EQ(estimate.status, GroundStatus::resumed);
    EXPECT_NEAR(estimate.gap, 31.0 / kRate, 1e-9);
    EXPECT_GT(estimate.pose_covariance(0, 0), before(0, 0) + 1.0);
    const Vector6 error = poseError(estimate, inOdometry(flight.base(i), flight.base(1)));
    EXPECT_LT(test::Normalised().add(error, estimate.pose_covariance), 22.5);  // 99.9 %
  }
  EXPECT_EQ(flight.step().status, GroundStatus::ok);
}

/// Lets `flight` pause for that many seconds. The matcher then begins anew, so the first frame has
/// no homography, and the second one refers to it. Calls `visit` with each frame before it is
/// added.
template <typename Visit>
void pauseFor(double seconds, Flight& flight, const Visit& visit) {
  constexpr int kBegin = 300;  // a keyframe
  const std::int64_t pause = std::llround(1e9 * seconds);
  flight.steps(kBegin);
  for (int i = kBegin; i < kBegin + 15; ++i) {
    GroundFrame frame = flight.next();
    frame.stamp += pause;
    frame.reference_stamp += pause;
    if (i == kBegin) frame.answer.reset();
    visit(i, frame);
  }
}

// Both images have readings of their own, so they need no doubt of the motion between them. Where
// one is missing, the velocity between them is not known.
TEST(GroundMotion, VelocitiesAfterAGapHaveATrueCovariance) {
  for (const double gap : {0.3, 1.0, 3.0}) {
    test::Normalised twists;
    for (unsigned seed = 1; seed <= 10; ++seed) {
      Flight flight = Flight::noisy(downward(), 1e-4, seed);
      flight.scale = 0.1;  // at 0.4 m
      pauseFor(gap, flight, [&](int i, const GroundFrame& frame) {
        const GroundEstimate& estimate = flight.ground.add(frame);
        if (i == 300) return;
        ASSERT_EQ(estimate.status, i == 301 ? GroundStatus::resumed : GroundStatus::ok)
            << gap << " " << seed << " " << i;
        ASSERT_TRUE(estimate.hasTwist());
        twists.add(flight.velocityError(i, estimate), estimate.twist_covariance);
      });
    }
    EXPECT_LT(twists.mean(), 5.0) << gap;
    EXPECT_GE(twists.within(16.27), 0.98) << gap;
  }
  for (const bool lacks_height : {true, false}) {
    Flight flight = Flight::noisy(downward(), 1e-4);
    pauseFor(1.0, flight, [&](int i, GroundFrame& frame) {
      if (i == 300 && lacks_height) frame.height.reset();
      if (i == 300 && !lacks_height) frame.down.reset();
      const GroundEstimate& estimate = flight.ground.add(frame);
      if (i == 300) return;
      EXPECT_EQ(estimate.status, i == 301 ? GroundStatus::resumed : GroundStatus::ok) << i;
      EXPECT_EQ(estimate.hasTwist(), i > 301) << i;
    });
  }
}

// The pose is not known then, and the covariance says so, but not more: the height and the tilt are
// found at once.
TEST(GroundMotion, ALongPauseKeepsTheCovarianceDefinite) {
  for (const double hours : {0.25, 8.0, 1000.0}) {
    for (const bool has_down : {true, false}) {
      Flight flight = Flight::noisy(mounted(), 1e-4);
      Eigen::Vector3d last = Eigen::Vector3d::Zero();
      pauseFor(3600.0 * hours, flight, [&](int i, GroundFrame& frame) {
        if (i == 300) last = baseOf(flight.truth(299), mounted()).position;
        if (!has_down) frame.down.reset();
        const GroundEstimate& estimate = flight.ground.add(frame);
        if (i < (has_down ? 301 : 305)) return;
        ASSERT_EQ(estimate.status, i == 301 ? GroundStatus::resumed : GroundStatus::ok)
            << hours << " " << has_down << " " << i;
        EXPECT_LT((estimate.base_to_odometry.translation() - last).norm(), 1000.0);
        const Covariance6& covariance = estimate.pose_covariance;
        EXPECT_EQ(covariance.llt().info(), Eigen::Success) << hours << " " << has_down << " " << i;
        EXPECT_NEAR(std::sqrt(covariance(0, 0)), 1000.0, 100.0);
        EXPECT_LT(std::sqrt(covariance(2, 2)), 0.1);
        EXPECT_NEAR(std::sqrt(covariance(5, 5)), EIGEN_PI, 0.5);
        EXPECT_LT(flight.velocityError(i, estimate).norm(), has_down ? 0.2 : 0.5) << i;
      });
    }
  }
}

TEST(GroundMotion, FindsTheNormalFromTheMotion) {
  Flight flight(mounted(), 1e-5);
  flight.gives_down = false;
  bool known = false;
  double first_tilt = 0.0;
  for (int i = 0; i < 300; ++i) {
    const GroundEstimate& estimate = flight.step();
    if (i == 1) {
      EXPECT_EQ(estimate.status, GroundStatus::no_normal);
      first_tilt = estimate.tilt_deviation;
    }
    if (estimate.status == GroundStatus::ok) known = true;
    if (i < 150) continue;
    ASSERT_TRUE(known);
    const Eigen::Vector3d up = estimate.base_to_odometry.linear().row(2);
    const double error = std::acos(up.dot(flight.base(i).axes.row(2)));
    EXPECT_LT(error, 4.0 * std::sqrt(2.0) * estimate.tilt_deviation + 1e-4) << i;
    EXPECT_LT(estimate.tilt_deviation, 0.05 * first_tilt);
  }
}

/// With the default `camera_to_base`, the base is the camera's frame, whose z axis points to the
/// ground.
TEST(GroundMotion, WithoutAMountingTheCameraStillLooksAtTheGround) {
  Flight flight(downward(), 1e-5);
  flight.gives_down = false;
  GroundMotion ground{GroundMotionOptions()};
  int known = 0;
  for (int i = 0; i < 200; ++i) {
    const GroundEstimate& estimate = ground.add(flight.next());
    if (!estimate.hasTwist()) continue;
    const Vector6 twist = kRate * motion::constantTwist(flight.truth(i - 1), flight.truth(i));
    EXPECT_LT((estimate.twist - twist).head<3>().norm(), 0.05 * twist.head<3>().norm()) << i;
    ++known;
  }
  EXPECT_GT(known, 150);
}

/// Result of a flight with some wrong readings.
struct Outcome {
  test::Normalised twists;   // without the frames while the readings are wrong
  double velocity = 0.0;     // largest error after a second of right readings, share of the speed
  double turn_ratio = 0.0;   // at the end
  bool always_known = true;  // every frame has a velocity
};

Outcome outcomeOf(const std::function<void(int, GroundFrame&)>& disturb, int wrong_from,
                  int wrong_to, double gyro = 0.0) {
  Flight flight = Flight::noisy(downward(), 3e-5);
  Outcome outcome;
  for (int i = 0; i < 300; ++i) {
    GroundFrame frame = flight.next();
    if (gyro != 0.0 && i > 0) {
      frame.turn = TurnReading{motion::rotationAbout(gyro * motion::turnOf(flight.turn(i))),
                               0.5 * kDegree / kRate};
    }
    disturb(i, frame);
    const GroundEstimate& estimate = flight.ground.add(frame);
    outcome.turn_ratio = estimate.turn_ratio;
    if (i < 2) continue;
    outcome.always_known &= estimate.hasTwist();
    if (!estimate.hasTwist()) continue;
    const Eigen::Vector3d error = flight.velocityError(i, estimate);
    if (i >= wrong_to + 30) {
      outcome.velocity =
          std::max(outcome.velocity, error.norm() / flight.twist(i).head<3>().norm());
    }
    if (i >= wrong_from && i < wrong_to) continue;
    outcome.twists.add(error, estimate.twist_covariance);
  }
  return outcome;
}

TEST(GroundMotion, WrongHeightsAreNotBelievedForever) {
  const auto none = [](int, GroundFrame&) {};
  const double usual = outcomeOf(none, 0, 0).velocity;
  const auto scaled = [](int from, int to, double factor) {
    return outcomeOf(
        [=](int i, GroundFrame& frame) {
          if (i >= from && i < to) frame.height->metres *= factor;
        },
        from, to);
  };
  const Outcome start = scaled(0, 4, 0.5);         // the first ranges of a flight
  const Outcome obstacle = scaled(100, 121, 0.6);  // 0.7 s over something
  const Outcome outlier = scaled(100, 101, 1.4);
  for (const Outcome& outcome : {start, obstacle, outlier}) {
    EXPECT_TRUE(outcome.always_known);
    EXPECT_LT(outcome.velocity, usual + 0.03);
    EXPECT_LT(outcome.twists.mean(), 8.0);
  }
  EXPECT_LT(outlier.velocity, usual + 0.01);
}

TEST(GroundMotion, TheGroundIsAnotherOneAfterAWhile) {
  Flight flight = Flight::noisy(mounted(), 3e-5, 1, 0.2 * kDegree);
  for (int i = 0; i < 200; ++i) {
    flight.length_factor = i >= 100 ? 1.3 : 1.0;
    const GroundEstimate& estimate = flight.step();
    if (i == 100) {
      EXPECT_FALSE(estimate.height_used);
      EXPECT_GT(estimate.height_misfit, GroundEstimate::kContradiction);
      EXPECT_NEAR(estimate.height, flight.truth(i).position.z(), 0.1);
    }
    if (i >= 2) {
      EXPECT_EQ(estimate.status, GroundStatus::ok) << i;
    }
    if (i >= 130) {
      EXPECT_NEAR(estimate.height, 1.3 * flight.truth(i).position.z(), 0.1) << i;
    }
  }
}

TEST(GroundMotion, WrongGyroscopeHasLittleInfluence) {
  const auto none = [](int, GroundFrame&) {};
  const double usual = outcomeOf(none, 0, 0).velocity;
  for (const double factor : {-1.0, 180.0 / 3.14159265358979323846}) {
    const Outcome outcome = outcomeOf(none, 0, 0, factor);
    EXPECT_TRUE(outcome.always_known);
    EXPECT_LT(outcome.velocity, usual + 0.1) << factor;
    EXPECT_LT(outcome.twists.mean(), 8.0) << factor;
    if (factor < 0.0) {
      EXPECT_NEAR(outcome.turn_ratio, factor, 0.2);
    }
  }
}

TEST(GroundMotion, CameraLookingAwayHasNoMotion) {
  Flight flight(downward(), 3e-5);
  for (int i = 0; i < 30; ++i) {
    const GroundEstimate& estimate = flight.step(turnAway);
    EXPECT_EQ(estimate.status, GroundStatus::looks_away);
    EXPECT_FALSE(estimate.hasPose());
  }
}

TEST(GroundMotion, SingleNormalLookingAwayIsContradicted) {
  Flight flight(downward(), 3e-5);
  flight.steps(50);
  for (int i = 50; i < 60; ++i) {
    const bool is_wrong = i == 52 || i == 53 || i == 57;
    const GroundEstimate& estimate = is_wrong ? flight.step(turnAway) : flight.step();
    EXPECT_EQ(estimate.status, GroundStatus::ok) << i;
    EXPECT_EQ(estimate.down_used, !is_wrong) << i;
    EXPECT_LT(flight.velocityError(i, estimate).norm(), 0.05) << i;
  }
}

TEST(GroundMotion, NormalsThatLookAwayAgainAndAgainAreBelieved) {
  Flight flight(downward(), 3e-5);
  flight.steps(50);
  GroundEstimate estimate;
  for (int i = 50; i < 70; ++i) estimate = flight.step(turnAway);
  EXPECT_EQ(estimate.status, GroundStatus::looks_away);
  EXPECT_FALSE(estimate.hasPose());
  flight.steps(10);
  EXPECT_TRUE(flight.step().hasTwist());
}

TEST(GroundMotion, EverySecondHeightThatIsWrongIsNamed) {
  Flight flight = Flight::noisy(downward(), 1e-4, 1, 0.05 * kDegree);
  int named = 0;
  for (int i = 0; i < 200; ++i) {
    const double factor = i % 2 == 1 ? 1.5 : 1.0;
    named += flight.step([=](auto& f) { f.height->metres *= factor; }).height_used ? 0 : 1;
  }
  EXPECT_GE(named, 90);
}

TEST(GroundMotion, NoiseBeyondItsDeviationIsNoContradictionAndASteadyErrorIs) {
  for (const bool is_steady : {false, true}) {
    Flight flight = Flight::noisy(downward(), 1e-4, 1, 1.0 * kDegree);
    if (is_steady) flight.tilt_noise = 0.05 * kDegree;
    double refused = 0.0, frames = 0.0;
    for (int i = 0; i < 300; ++i) {
      const GroundEstimate& estimate = flight.step([&](GroundFrame& frame) {
        frame.down->deviation = 0.05 * kDegree;
        // A mounting that is wrong, after a good start: it would be the truth otherwise.
        if (is_steady && i > 100) turn(frame, 2.0 * kDegree);
      });
      if (is_steady ? i < 101 || i > 104 : i < 100) continue;
      ++frames;
      refused += estimate.down_used ? 0.0 : 1.0;
    }
    if (is_steady) {
      EXPECT_EQ(refused, frames);
    } else {
      EXPECT_LT(refused, 0.03 * frames);
    }
  }
}

TEST(GroundMotion, AnOutlierDoesNotHideLaterContradictions) {
  Flight flight = Flight::noisy(downward(), 1e-4, 1, 0.05 * kDegree);
  for (int i = 0; i < 120; ++i) {
    const double factor = i == 100 ? 0.1 : i > 104 ? 0.85 : 1.0;
    const bool is_used = flight.step([=](auto& f) { f.height->metres *= factor; }).height_used;
    if (i < 100 || i > 105) continue;
    EXPECT_EQ(is_used, i > 100 && i < 105) << i;
  }
}

TEST(GroundMotion, AfterARefusedFrameTheTurnIsIncomplete) {
  Flight flight(downward(), 3e-5);
  const auto next = [&](int i) {
    GroundFrame frame = flight.next();
    frame.turn = TurnReading{flight.turn(std::max(i, 1)), 1e-5};
    return frame;
  };
  for (int i = 0; i < 52; ++i) flight.ground.add(next(i));
  GroundFrame mirrored = next(52);
  mirrored.answer->homography.col(0) *= -1.0;
  EXPECT_THROW(flight.ground.add(mirrored), std::invalid_argument);
  EXPECT_EQ(flight.ground.add(next(53)).turn_misfit, 0.0);  // not given for the whole way
  EXPECT_GT(flight.ground.add(next(54)).turn_misfit, 0.0);
}

TEST(GroundMotion, PeriodOffsetIsAJump) {
  for (const double scale : {0.25, 1.0, 2.5}) {  // at about one metre, four and ten
    Flight flight(downward(), 3e-5);
    flight.scale = scale;
    flight.steps(53);
    CameraPose moved = flight.truth(53);
    moved.position.x() += scale > 1.0 ? 0.15 : 0.1;  // 4.5 and 3 m/s
    const auto set = [&](auto& f) { f.answer->homography = between(flight.truth(50), moved); };
    EXPECT_EQ(flight.step(set).status, GroundStatus::contradiction) << scale;
    EXPECT_EQ(flight.step().status, GroundStatus::ok) << scale;
  }
}

TEST(GroundMotion, FromALargeHeightTheNoiseOfPicturesIsNoJump) {
  for (const double noise : {1e-4, 5e-4}) {
    Flight flight = Flight::noisy(downward(), noise);
    flight.scale = 30.0;  // 120 m
    flight.next();
    EXPECT_EQ(flight.step().status, GroundStatus::started);
    for (int i = 2; i < 100; ++i) {
      EXPECT_EQ(flight.step().status, GroundStatus::ok) << noise << " " << i;
    }
  }
}

TEST(GroundMotion, LastingJumpIsBelieved) {
  for (const int keyframe_every : {1, 30}) {  // as with the reference previous, and keyframe
    Flight flight(downward(), 3e-5);
    flight.keyframe_every = keyframe_every;
    flight.gust_from = 40;
    flight.steps(40);
    int refused = 0;
    for (int i = 40; i < 60; ++i) {
      const GroundEstimate& estimate = flight.step();
      refused += estimate.status == GroundStatus::contradiction ? 1 : 0;
      if (i < 46) continue;
      EXPECT_EQ(estimate.status, GroundStatus::ok) << keyframe_every << " " << i;
      const CameraPose before = flight.truth(i - 1);
      const Eigen::Vector3d way = flight.truth(i).position - before.position;
      const Eigen::Vector3d wanted = kRate * before.axes.transpose() * way;
      EXPECT_LT((estimate.twist.head<3>() - downward().linear() * wanted).norm(), 0.3) << i;
    }
    EXPECT_GE(refused, 2) << keyframe_every;
    EXPECT_LE(refused, 3) << keyframe_every;
  }
}

/// Frames of a camera with a rolling shutter: homographies from points with noise of their own.
struct RollingFlight {
  std::function<CameraPose(double)> posed;  // at a time, s
  double readout = 0.0;                     // s
  double noise = 3e-5;                      // noise of a pair of points, focal length 1
  double lens = 0.0;                        // radial distortion that nobody knows of
  unsigned seed = 1;
  cv::Size size{640, 480};

  Vector6 twist(int frame) const {
    return kRate * motion::constantTwist(baseOf(posed((frame - 1) / kRate), downward()),
                                         baseOf(posed(frame / kRate), downward()));
  }

  /// Where a point of the ground is seen, focal length 1.
  Eigen::Vector2d seen(const Eigen::Vector2d& ground, int frame) const {
    Eigen::Vector2d point = Eigen::Vector2d::Zero();
    for (int i = 0; i < 5; ++i) {
      const double late = readout * camera()(1, 1) / size.height * point.y();
      const CameraPose pose = posed(frame / kRate + late);
      point = (motion::imageFromGround(pose) * ground.homogeneous()).hnormalized();
    }
    return point * (1.0 + lens * point.squaredNorm());
  }

  GroundFrame at(int i, int keyframe) const {
    // A part is of the keyframe's points, the same for all frames after it.
    std::mt19937 keyframe_numbers(1000000 * seed + 2 * keyframe);
    std::mt19937 frame_numbers(1000000 * seed + 2 * i + 1);
    // One each: a distribution keeps a number that it has drawn in vain.
    std::normal_distribution<double> of_keyframe(0.0, std::sqrt(motion::kOfKeyframe) * noise);
    std::normal_distribution<double> of_frame(0.0, std::sqrt(motion::kOfFrame) * noise);
    const CameraPose pose = posed(i / kRate);
    // The homography by least squares.
    Eigen::Matrix<double, Eigen::Dynamic, 8> rows(2 * 49, 8);
    Eigen::VectorXd wanted(2 * 49);
    for (int k = 0; k < 49; ++k) {
      const Eigen::Vector3d ray(0.18 * (k % 7 - 3), 0.14 * (k / 7 - 3), 1.0);
      const Eigen::Vector3d beam = pose.axes * ray;
      const Eigen::Vector2d point = (pose.position - pose.position.z() / beam.z() * beam).head<2>();
      const Eigen::Vector2d p = seen(point, keyframe);
      const Eigen::Vector2d q = seen(point, i);
      rows.row(2 * k) << p.x(), p.y(), 1.0, 0.0, 0.0, 0.0, -q.x() * p.x(), -q.x() * p.y();
      rows.row(2 * k + 1) << 0.0, 0.0, 0.0, p.x(), p.y(), 1.0, -q.y() * p.x(), -q.y() * p.y();
      for (int axis = 0; axis < 2; ++axis) {
        wanted[2 * k + axis] = q[axis] + of_keyframe(keyframe_numbers) + of_frame(frame_numbers);
      }
    }
    const Eigen::Matrix<double, 8, 8> information = rows.transpose() * rows;
    const Vector8 entries = information.ldlt().solve(rows.transpose() * wanted);
    Eigen::Matrix<double, 3, 3, Eigen::RowMajor> unit = Eigen::Matrix3d::Identity();
    Eigen::Map<Vector8>(unit.data()) = entries;
    const Eigen::Matrix3d h = camera() * unit * camera().inverse();
    GroundFrame frame;
    frame.stamp = stampOf(i);
    frame.reference_stamp = stampOf(keyframe);
    frame.camera = camera();
    frame.size = size;
    frame.answer.emplace().homography = h / h(2, 2);
    const auto to_pixels = numericSlope<8>([&](const Vector8& e) {
      Eigen::Matrix<double, 3, 3, Eigen::RowMajor> m = unit;
      Eigen::Map<Vector8>(m.data()) += e;
      return motion::entriesOf(camera() * m * camera().inverse());
    });
    // As the matcher does it: what is left beside the noise is deviation from the plane.
    const double left = (rows * entries - wanted).squaredNorm() / (2.0 * 49.0 - 8.0);
    const double square = std::max(noise * noise, lens == 0.0 ? 0.0 : left);
    frame.answer->plane_deviation = camera()(0, 0) * std::sqrt(square - noise * noise);
    frame.answer->covariance = square * to_pixels * information.inverse() * to_pixels.transpose();
    HeightReading height;
    height.metres = pose.position.z();
    height.deviation = 0.01 * height.metres;
    frame.height = height;
    frame.down = DownReading{-pose.axes.row(2).transpose(), 0.5 * kDegree};
    return frame;
  }
};

/// A flight that turns and climbs, so that the pictures show the shutter.
RollingFlight shutterShowing(double readout) {
  RollingFlight flight;
  flight.readout = readout;
  flight.posed = [](double t) {
    return CameraPose{
        downward().linear() *
            motion::rotationAbout({0.1 * std::sin(5.0 * t), 0.1 * std::sin(4.0 * t), 0.3 * t}),
        {std::sin(3.0 * t), 0.8 * std::cos(2.0 * t), 2.0 + 0.4 * std::sin(2.5 * t)}};
  };
  return flight;
}

GroundMotion withReadout(double seconds) {
  GroundMotionOptions options = optionsWith(downward());
  options.readout_time = seconds;
  return GroundMotion(options);
}

struct ShownShutter {
  double speed_error = 0.0;  // RMS of the velocity, m/s; the speed is about 3 m/s
  GroundEstimate last;

  /// `given`: the readout time of the options.
  ShownShutter(double readout, double given) {
    const RollingFlight flight = shutterShowing(readout);
    GroundMotion ground = withReadout(given);
    constexpr int kBegin = 60, kFrames = 300;
    for (int i = 1; i < kFrames; ++i) {
      last = ground.add(flight.at(i, (i - 1) / 5 * 5));
      if (i < kBegin) continue;
      EXPECT_TRUE(last.hasTwist()) << i;
      speed_error += (last.twist - flight.twist(i)).head<3>().squaredNorm() / (kFrames - kBegin);
    }
    speed_error = std::sqrt(speed_error);
  }
};

/// Below 0: the last row is exposed first, as where the driver turns the images by 180 degrees.
TEST(GroundMotion, TheRollingShutterIsFoundAndTakenOut) {
  for (const double readout : {0.015, -0.015}) {
    for (const double given : {-1.0, readout}) {
      const ShownShutter shown(readout, given);
      EXPECT_NEAR(shown.last.readout_time, readout, 0.001) << given;
      EXPECT_LT(shown.last.readout_deviation, 0.001) << given;
      EXPECT_LT(shown.speed_error, 0.05) << readout << " " << given;
    }
  }
}

/// The number of a data sheet for images that the driver turns: the pictures outweigh it.
TEST(GroundMotion, PicturesContradictAReadoutTimeOfTheWrongSign) {
  const ShownShutter shown(-0.015, 0.015);
  EXPECT_LT(shown.last.readout_time, 0.7 * 0.015 - 5.0 * shown.last.readout_deviation);
  EXPECT_LT(shown.last.readout_time, 0.0);
}

// A straight flight at constant speed does not show the shutter. The noise of the pictures must not
// pass for it: the flow and the homography that it explains have this noise in common.
TEST(GroundMotion, StraightFlightReportsNoShutter) {
  for (const Eigen::Vector3d& velocity :
       {Eigen::Vector3d(0.0, 1.0, 0.0), Eigen::Vector3d(1.0, 0.0, 0.0),
        Eigen::Vector3d(0.3, 0.3, 0.02), Eigen::Vector3d(0.0, 0.0, 0.0)}) {
    for (const int keyframe_every : {1, 5}) {
      double readout2 = 0.0;
      test::Normalised way;
      constexpr int kRuns = 6;
      for (unsigned seed = 1; seed <= kRuns; ++seed) {
        RollingFlight flight;
        flight.noise = 3e-4;
        flight.seed = seed;
        flight.posed = [&](double t) {
          return CameraPose{downward().linear(), Eigen::Vector3d(0.0, 0.0, 2.0) + t * velocity};
        };
        GroundMotion ground(optionsWith(downward()));
        GroundEstimate last;
        constexpr int kFrames = 600;
        for (int i = 1; i < kFrames; ++i) {
          last = ground.add(flight.at(i, (i - 1) / keyframe_every * keyframe_every));
        }
        const double readout = last.readout_time / last.readout_deviation;
        EXPECT_LT(std::abs(readout), 3.5) << velocity.transpose() << ", " << keyframe_every;
        const CameraPose wanted =
            inOdometry(baseOf(flight.posed((kFrames - 1) / kRate), downward()),
                       baseOf(flight.posed(1 / kRate), downward()));
        const Eigen::Vector3d error = poseError(last, wanted).head<3>();
        readout2 += readout * readout / kRuns;
        way.add(error, last.pose_covariance);
      }
      EXPECT_LT(readout2, 2.5) << velocity.transpose() << ", " << keyframe_every;
      EXPECT_LT(way.mean(), 3.0 * 2.5) << velocity.transpose() << ", " << keyframe_every;
    }
  }
}

/// A straight flight along the columns does not show the readout time, and as much as it is wrong,
/// the velocity is: the covariance has it.
TEST(GroundMotion, VelocityOfAStraightFlightHasTheDoubtOfTheShutter) {
  for (const int keyframe_every : {1, 5}) {
    test::Normalised along;
    double worst = 0.0;
    double sum_of_shares = 0.0;  // of the errors in the speed
    for (const double readout : {0.0, 0.015, 0.02, 0.025}) {
      for (const double speed : {2.0, -3.0, 4.0}) {
        RollingFlight flight;
        flight.readout = readout;
        flight.noise = 3e-4;
        flight.seed = static_cast<unsigned>(10.0 + speed + 1e4 * readout);
        flight.posed = [&](double t) {
          return CameraPose{downward().linear(), Eigen::Vector3d(0.0, speed * t, 2.0)};
        };
        GroundMotion ground(optionsWith(downward()));
        constexpr int kFrames = 300;
        for (int i = 1; i < kFrames; ++i) {
          const GroundEstimate& found =
              ground.add(flight.at(i, (i - 1) / keyframe_every * keyframe_every));
          if (i < 60) continue;
          ASSERT_TRUE(found.hasTwist()) << i;
          const Eigen::Vector3d error = (found.twist - flight.twist(i)).head<3>();
          const Eigen::Matrix3d covariance = found.twist_covariance.topLeftCorner<3, 3>();
          along.add(Eigen::Matrix<double, 1, 1>(error.y()),
                    Eigen::Matrix<double, 1, 1>(covariance(1, 1)));
          worst = std::max(worst, std::abs(error.y()) / std::sqrt(covariance(1, 1)));
          sum_of_shares += error.y() / speed;
        }
      }
    }
    const double bias = sum_of_shares / static_cast<double>(along.count());
    std::printf("a keyframe every %d: mean square %.2f, worst %.2f deviations, mean %.3f %%\n",
                keyframe_every, along.mean(), worst, 100.0 * bias);
    EXPECT_LT(std::abs(bias), 0.015) << keyframe_every;
    EXPECT_LT(worst, 3.5) << keyframe_every;
    EXPECT_LT(along.mean(), 1.5) << keyframe_every;
  }
}

/// An image has been read when the next one begins.
TEST(GroundMotion, UnknownReadoutTimeIsAtMostTheTimeBetweenTwoImages) {
  RollingFlight flight;
  flight.posed = [](double t) {
    return CameraPose{downward().linear(), Eigen::Vector3d(0.0, 2.0 * t, 2.0)};
  };
  for (const int rate : {30, 120, 5}) {
    GroundMotion ground(optionsWith(downward()));
    GroundEstimate last;
    for (int i = 1; i < 20; ++i) {
      GroundFrame frame = flight.at(i, i - 1);
      frame.stamp = test::stampOf(0) + std::llround(1e9 * i / rate);
      frame.reference_stamp = test::stampOf(0) + std::llround(1e9 * (i - 1) / rate);
      last = ground.add(frame);
    }
    const double longest = 1.0 / std::max(rate, 30);  // s
    EXPECT_LE(last.readout_deviation, longest / std::sqrt(3.0) + 1e-6) << rate;
    EXPECT_GT(last.readout_deviation, 0.9 * longest / std::sqrt(3.0)) << rate;
  }
}

// Neither the time back from a stamp far ahead nor two stamps close together tell anything about
// the camera.
TEST(GroundMotion, AWrongStampDoesNotChangeTheReadoutTime) {
  const RollingFlight flight = shutterShowing(0.015);
  constexpr std::int64_t kSecond = 1'000'000'000;
  for (const std::int64_t wrong : {100 * kSecond, 30'000'000L}) {
    for (const double given : {-1.0, 0.015}) {
      GroundMotion ground = withReadout(given);
      for (int i = 1; i < 150; ++i) {
        GroundFrame frame = flight.at(i, (i - 1) / 5 * 5);
        if (i == 98) {
          frame.stamp += wrong;
          frame.answer.reset();
        }
        const GroundEstimate& found = ground.add(frame);
        if (i < 60) continue;
        EXPECT_NEAR(found.readout_time, 0.015, 0.001) << wrong << " " << given << " " << i;
        if (i < 100) continue;
        ASSERT_TRUE(found.hasTwist()) << wrong << " " << given << " " << i;
        EXPECT_LT((found.twist - flight.twist(i)).head<3>().norm(), 0.15)
            << wrong << " " << given << " " << i;
      }
    }
  }
}

// The next homography is right, and so must be the effect of the shutter on it.
TEST(GroundMotion, ARefusedHomographyDoesNotChangeTheFlow) {
  RollingFlight flight;
  flight.readout = 0.02;
  flight.posed = [](double t) {
    return CameraPose{
        downward().linear() *
            motion::rotationAbout({0.05 * std::sin(5.0 * t), 0.05 * std::sin(4.0 * t), 0.3 * t}),
        {t, 0.2 * std::sin(t), 2.0}};
  };
  for (const double given : {-1.0, 0.02}) {
    GroundMotion ground = withReadout(given);
    for (int i = 1; i < 110; ++i) {
      GroundFrame frame = flight.at(i, i - 1);
      if (i == 100) {  // off by 60 px along the columns
        frame.answer->homography.row(1) += 60.0 * frame.answer->homography.row(2);
        frame.answer->homography /= frame.answer->homography(2, 2);
      }
      const GroundEstimate& found = ground.add(frame);
      if (i < 98) continue;
      ASSERT_EQ(found.status, i == 100   ? GroundStatus::contradiction
                              : i == 101 ? GroundStatus::resumed
                                         : GroundStatus::ok)
          << given << " " << i;
      if (i == 100) continue;
      const Eigen::Vector3d error = (found.twist - flight.twist(i)).head<3>();
      EXPECT_LT(error.norm(), 0.1) << given << " " << i;
    }
  }
}

TEST(GroundMotion, HoverKeepsPlaceAndCovariance) {
  RollingFlight flight;
  flight.noise = 2e-4;
  flight.posed = [](double t) {
    return CameraPose{downward().linear() *
                          motion::rotationAbout({0.03 * std::sin(1.9 * t), 0.03 * std::sin(1.5 * t),
                                                 0.05 * std::sin(0.3 * t)}),
                      {0.05 * std::sin(0.7 * t), 0.05 * std::cos(0.5 * t), 2.0}};
  };
  GroundMotion ground(optionsWith(downward()));
  constexpr int kFrames = 7200;  // 4 minutes
  test::Normalised twists;
  for (int i = 1; i < kFrames; ++i) {
    const GroundEstimate& found = ground.add(flight.at(i, (i - 1) / 30 * 30));
    if (i < 30) continue;
    ASSERT_TRUE(found.hasTwist()) << i;
    const Eigen::Vector3d error = (found.twist - flight.twist(i)).head<3>();
    twists.add(error, found.twist_covariance);
  }
  EXPECT_LT(twists.mean(), 8.0);
  EXPECT_GT(twists.mean(), 1.51);
}

// The faults of a real rig, all at once: a rolling shutter of 20 ms, an Imu that is 1 degree off
// and 20 ms late, a lens that is .5 px off in the corners, a box below the range sensor, and frames
// without a homography; from take-off over a hover to landing.
TEST(GroundMotion, AnImperfectRigHasVelocitiesWithATrueCovariance) {
  constexpr double kLate = 0.02;  // s
  constexpr int kFrames = 1200;
  const auto step = [](double x) {
    const double u = std::clamp(x, 0.0, 1.0);
    return u * u * (3.0 - 2.0 * u);
  };
  for (const auto& [keyframe_every, has_gyro] :
       {std::pair(1, false), std::pair(1, true), std::pair(5, false), std::pair(5, true)}) {
    test::Normalised twists;
    double frames = 0.0;
    for (unsigned seed = 1; seed <= 4; ++seed) {
      RollingFlight flight;
      flight.noise = 2e-4;
      flight.readout = 0.02;
      flight.lens = 0.003;
      flight.seed = seed;
      flight.posed = [&](double t) {
        const double moving = step((t - 6.0) / 2.0) - step((t - 14.0) / 2.0) +
                              step((t - 22.0) / 2.0) - step((t - 34.0) / 2.0);
        const double s = static_cast<double>(seed);
        return CameraPose{
            downward().linear() *
                motion::rotationAbout({0.08 * std::sin(1.9 * t + s), 0.07 * std::sin(1.5 * t),
                                       0.2 * moving * std::sin(0.4 * t)}),
            {moving * std::sin(0.7 * t + s) + 0.02 * std::sin(2.0 * t),
             0.02 * std::sin(1.7 * t) + 1.5 * moving * std::cos(0.5 * t),
             0.3 + 2.0 * step(t / 6.0) - 2.0 * step((t - 34.0) / 6.0)}};
      };
      GroundMotion ground(optionsWith(downward()));
      const Eigen::Matrix3d mounted =
          motion::rotationAbout(kDegree * Eigen::Vector3d(0.8, 0.6, 0.0));
      for (int i = 1; i < kFrames; ++i) {
        GroundFrame frame = flight.at(i, (i - 1) / keyframe_every * keyframe_every);
        const CameraPose read = flight.posed(i / kRate - kLate);
        const bool is_over_box = i > 720 && i < 780;
        frame.height->metres = read.position.z() - (is_over_box ? 0.3 : 0.0);
        frame.down->direction = mounted * -read.axes.row(2).transpose();
        frame.down->of_imu = true;
        if (has_gyro) {
          const CameraPose before = flight.posed((i - 1) / kRate - kLate);
          frame.turn =
              TurnReading{mounted * before.axes.transpose() * read.axes * mounted.transpose(),
                          0.1 * kDegree / kRate};
        }
        if (i % 97 < 5) frame.answer.reset();
        const bool has_homography = frame.answer.has_value();
        const GroundEstimate& found = ground.add(frame);
        if (!has_homography || i < 30) continue;
        ++frames;
        if (!found.hasTwist()) continue;
        const Eigen::Vector3d error = (found.twist - flight.twist(i)).head<3>();
        twists.add(error, found.twist_covariance);
      }
    }
    EXPECT_GE(static_cast<double>(twists.count()), 0.97 * frames)
        << keyframe_every << " " << has_gyro;
    EXPECT_GT(twists.mean(), 2.0) << keyframe_every << " " << has_gyro;
    EXPECT_LT(twists.mean(), 8.0) << keyframe_every << " " << has_gyro;
    EXPECT_GE(twists.within(16.27), 0.96) << keyframe_every << " " << has_gyro;
  }
}

/// A camera flies at 1 m/s, and from the third to the sixth second a lorry, which drives at 1.5 m/s
/// to the side, covers a part of the picture. The homography is PROSAC's.
class FlightOverALorry {
 public:
  /// `covered`: share of the picture.
  explicit FlightOverALorry(double covered) : covered_(covered) {
    flight_.noise = 2e-4;
    flight_.posed = [](double t) {
      return CameraPose{
          downward().linear() * motion::rotationAbout({0.05 * std::sin(1.9 * t), 0.0, 0.1 * t}),
          {t, 0.3 * std::sin(t), 3.0}};
    };
  }
  static bool isThere(int i) { return i >= 90 && i < 180; }

  GroundFrame at(int i) {
    GroundFrame frame = flight_.at(i, i - 1);
    std::mt19937 random(i);
    std::normal_distribution<double> normal(0.0, 0.2);
    std::uniform_real_distribution<double> quality(0.3, 0.9);
    const Eigen::Matrix3d to_ground =
        motion::imageFromGround(flight_.posed((i - 1) / kRate)).inverse() * camera().inverse();
    pairs_.clear();
    for (int y = 20; y < 480; y += 40) {
      for (int x = 10; x < 640; x += 20) {
        Eigen::Vector2d point = (to_ground * Eigen::Vector3d(x, y, 1.0)).hnormalized();
        if (isThere(i) && x < 640.0 * covered_) point.y() += 1.5 / kRate;
        const Eigen::Vector3d seen = camera() * flight_.seen(point, i).homogeneous();
        pairs_.reference.emplace_back(x, y);
        pairs_.target.emplace_back(seen.hnormalized() +
                                   Eigen::Vector2d(normal(random), normal(random)));
        pairs_.quality.push_back(quality(random));
      }
    }
    prosac_.estimate(pairs_, flight_.size, found_);
    frame.answer.reset();
    if (found_.status == Status::ok) frame.answer = found_.answer;
    return frame;
  }
  Vector6 twist(int i) const { return flight_.twist(i); }

 private:
  RollingFlight flight_;
  double covered_;
  PointPairs pairs_;
  ProsacHomography prosac_;
  ProsacResult found_;
};

// Where it covers less than half of the picture, velocities get less certain, and their covariance
// says so. Where it covers more it is taken for the ground, until it has gone.
TEST(GroundMotion, MovingObjectMakesVelocitiesLessCertain) {
  for (const double covered : {0.3, 0.45, 0.6}) {
    FlightOverALorry lorry(covered);
    GroundMotion ground(optionsWith(downward()));
    test::Normalised twists;
    double frames = 0.0, largest = 0.0, largest_without = 0.0;
    for (int i = 1; i < 270; ++i) {
      const GroundEstimate& found = ground.add(lorry.at(i));
      if (i < 30) continue;
      const bool is_there = FlightOverALorry::isThere(i);
      frames += is_there ? 1.0 : 0.0;
      if (!found.hasTwist()) continue;
      const Eigen::Vector3d error = (found.twist - lorry.twist(i)).head<3>();
      double& of_part = is_there ? largest : largest_without;
      of_part = std::max(of_part, error.norm());
      if (is_there) twists.add(error, found.twist_covariance);
    }
    EXPECT_GE(static_cast<double>(twists.count()), 0.97 * frames) << covered;
    EXPECT_LT(largest_without, 0.1) << covered;
    if (covered > 0.5) continue;
    EXPECT_LT(largest, covered < 0.4 ? 0.15 : 0.6) << covered;
    EXPECT_LT(twists.mean(), 8.0) << covered;
  }
}

TEST(GroundMotion, RefusesAHomographyThatContradictsTheGround) {
  Flight flight(mounted(), 3e-5);
  flight.steps(53);
  const auto enlarge = [](GroundFrame& frame) {
    frame.reference_stamp = stampOf(50);
    frame.answer->homography(0, 0) *= 1.2;
  };
  EXPECT_EQ(flight.step(enlarge).status, GroundStatus::contradiction);
  EXPECT_EQ(flight.step().status, GroundStatus::ok);  // by the same keyframe
  for (int i = 55; i < 65; ++i) {
    EXPECT_EQ(flight.step(enlarge).status, GroundStatus::contradiction);
  }
  EXPECT_EQ(flight.step().status, GroundStatus::resumed);
}

TEST(GroundMotion, GyroscopeReplacesNormal) {
  const auto deviation = [](bool with_gyro) {
    Flight flight = Flight::noisy(mounted(), 1e-4, 1, 2.0 * kDegree);
    flight.perspective = 30.0;  // so a rotation looks like a translation
    Covariance6 covariance;
    for (int i = 0; i < 60; ++i) {
      const auto read = [&](GroundFrame& frame) {
        if (with_gyro && i > 0) frame.turn = TurnReading{flight.turn(i), 1e-5};
      };
      covariance = flight.step(read).twist_covariance;
    }
    return std::sqrt(covariance(0, 0));
  };
  EXPECT_LT(deviation(true), 0.7 * deviation(false));
}

TEST(GroundMotion, GyroscopeBridgesFramesWithoutHomography) {
  Flight flight(mounted(), 1e-5);
  for (int i = 0; i < 60; ++i) {
    GroundFrame frame = flight.next();
    if (i > 0) frame.turn = TurnReading{flight.turn(i), 1e-4};
    if (i % 10 == 4 || i % 10 == 5) frame.answer.reset();
    if (i == 26) frame.turn.reset();
    const GroundEstimate& estimate = flight.ground.add(frame);
    EXPECT_LT(estimate.turn_misfit, 3.0) << i;
    if (i > 1 && frame.answer) {
      EXPECT_EQ(estimate.status, GroundStatus::ok) << i;
      EXPECT_EQ(estimate.turn_misfit > 0.0, i != 26) << i;
    }
  }
}

TEST(GroundMotion, ScaleErrorCountsForTheWholeWay) {
  Flight flight(mounted(), 1e-8);
  GroundMotionOptions options = optionsWith(mounted());
  options.scale_deviation = 0.02;
  flight.ground = GroundMotion(options);
  flight.steps(100);
  const GroundEstimate& estimate = flight.step();
  const double way = estimate.base_to_odometry.translation().x();
  EXPECT_GT(way, 5.0);
  EXPECT_NEAR(std::sqrt(estimate.pose_covariance(0, 0)), 0.02 * way, 0.002 * way);
  EXPECT_NEAR(std::sqrt(estimate.twist_covariance(0, 0)), 0.02 * std::abs(estimate.twist(0)), 1e-3);
}

/// Frames of a base at the positions and angles (yaw, pitch, roll) of `at`, with exact readings.
class StraightFlight : public test::GroundPictures {
 public:
  explicit StraightFlight(const Pose3& camera_to_base, double image_noise = 1e-6)
      : GroundPictures(image_noise, 1), camera_to_base_(camera_to_base) {}

  GroundFrame at(const Eigen::Vector3d& position, const Eigen::Vector3d& angles) {
    const CameraPose pose = test::cameraAt(position, angles, camera_to_base_);
    GroundFrame frame = seenFrom(pose);
    frame.height.emplace();
    frame.height->metres = pose.position.z();
    frame.height->deviation = 1e-3;
    frame.down.emplace();
    frame.down->direction = -pose.axes.row(2).transpose();
    frame.down->deviation = 1e-3;
    return frame;
  }

 private:
  Pose3 camera_to_base_;
};

Pose3 aheadOfTheBase(double ahead, double above) {
  Pose3 pose = downward();
  pose.translation() << ahead, 0.0, above;
  return pose;
}

double deviationOf(const Covariance6& covariance, int i) {
  return std::sqrt(covariance(i, i));
}

// The camera moves on a circle about the base, which stays on the ground.
TEST(GroundMotion, AScaleErrorDoesNotChangeTheLever) {
  const Pose3 ahead = aheadOfTheBase(1.0, 1.0);
  GroundMotionOptions options = optionsWith(ahead);
  options.scale_deviation = 0.05;
  GroundMotion ground(options);
  StraightFlight flight(ahead);
  for (int i = 0; i < 60; ++i) {
    GroundFrame frame = flight.at({0.0, 0.0, 0.0}, {i / kRate, 0.0, 0.0});
    frame.height->metres *= 1.05;
    const GroundEstimate& estimate = ground.add(frame);
    if (i < 5) continue;
    ASSERT_TRUE(estimate.hasTwist());
    EXPECT_NEAR(estimate.twist(1), 0.05, 0.01) << "the camera seems to be on a larger circle";
    EXPECT_LT(std::abs(estimate.twist(1)), 2.0 * deviationOf(estimate.twist_covariance, 1)) << i;
    const Eigen::Vector3d position = estimate.base_to_odometry.translation();
    EXPECT_LT(std::abs(position.z()), 2.0 * deviationOf(estimate.pose_covariance, 2)) << i;
    EXPECT_LT(std::abs(position.y()), 2.0 * deviationOf(estimate.pose_covariance, 1) + 1e-3) << i;
  }
}

// The picture of frame 20 has no homography and a normal that points to the sky.
TEST(GroundMotion, ANormalThatPointsUpInAGapDoesNotTurnTheGroundOver) {
  Flight flight(mounted(), 1e-6);
  flight.scale = 0.1;
  flight.keyframe_every = 1;
  for (int i = 0; i < 60; ++i) {
    const GroundEstimate& estimate = flight.step([&](GroundFrame& frame) {
      if (i == 19 || i == 20) frame.answer.reset();
      if (i == 20) turnAway(frame);
      if (i == 21) frame.down.reset();
    });
    if (i > 2 && estimate.hasTwist()) {
      EXPECT_LT(flight.velocityError(i, estimate).norm(), 0.1) << i;
    }
    if (i > 25) {
      EXPECT_EQ(estimate.status, GroundStatus::ok) << i;
    }
  }
}

TEST(GroundMotion, ResultsDoNotDependOnTheEpoch) {
  const auto last = [](std::int64_t first_stamp) {
    Flight flight(mounted(), 1e-5);
    GroundEstimate estimate;
    for (int i = 0; i < 40; ++i) {
      estimate = flight.step([&](GroundFrame& frame) {
        frame.size = {640, 480};
        frame.stamp += first_stamp - stampOf(0);
        if (i > 0) frame.reference_stamp += first_stamp - stampOf(0);
      });
    }
    return estimate;
  };
  const GroundEstimate at_zero = last(0);
  const GroundEstimate later = last(1'000'000'000);
  EXPECT_LT((at_zero.twist - later.twist).norm(), 1e-9);
  EXPECT_NEAR(at_zero.readout_time, later.readout_time, 1e-9);
  EXPECT_NEAR(at_zero.readout_deviation, later.readout_deviation, 1e-9);
}

TEST(GroundMotion, AnUnknownHeadingStaysUnknownInAGap) {
  for (const double tilt : {0.0, 0.3}) {
    GroundMotion ground(optionsWith(downward()));
    StraightFlight flight(downward());
    Covariance6 covariance = Covariance6::Zero();
    covariance(5, 5) = 1.0;
    const auto seen = [&](int i) {
      // rolls while there is no homography
      const double roll = tilt * std::clamp((i - 40) / 10.0, 0.0, 1.0);
      return flight.at({10.0 * i / kRate, 0.0, 20.0}, {0.0, 0.0, roll});
    };
    for (int i = 0; i < 20; ++i) ground.add(seen(i));
    ground.setPose(Pose3::Identity(), covariance);
    ground.add(seen(20));
    double way = 0.0;
    for (int i = 21; i < 60; ++i) {
      GroundFrame frame = seen(i);
      if (i > 40 && i <= 50) frame.answer.reset();
      const GroundEstimate& estimate = ground.add(frame);
      if (!estimate.hasPose()) continue;
      way = estimate.base_to_odometry.translation().head<2>().norm();
      // The heading, and where the base is to the side.
      EXPECT_NEAR(deviationOf(estimate.pose_covariance, 5), 1.0, 0.05) << i;
      EXPECT_NEAR(deviationOf(estimate.pose_covariance, 1), way, 0.1 * way + 0.02) << i;
    }
    EXPECT_GT(way, 12.0);
  }
}

TEST(GroundMotion, SetPoseGivesTheCovarianceOfTheBase) {
  const Pose3 ahead = aheadOfTheBase(1.0, 0.5);
  GroundMotion ground(optionsWith(ahead));
  StraightFlight flight(ahead);
  Covariance6 covariance = Covariance6::Zero();
  covariance.diagonal() << 1e-4, 4e-4, 0.0, 0.0, 0.0, 0.25;
  for (int i = 0; i < 20; ++i) ground.add(flight.at({0.01 * i, 0.0, 2.0}, {0.2, 0.05, -0.1}));
  Pose3 wanted = Pose3::Identity();
  wanted.linear() = motion::rotationAbout(Eigen::Vector3d(0.0, 0.0, 0.7));
  ground.setPose(wanted, covariance);
  const GroundEstimate& estimate = ground.add(flight.at({0.2, 0.0, 2.0}, {0.2, 0.05, -0.1}));
  ASSERT_EQ(estimate.status, GroundStatus::ok);
  EXPECT_NEAR(deviationOf(estimate.pose_covariance, 0), 0.01, 2e-3);
  EXPECT_NEAR(deviationOf(estimate.pose_covariance, 1), 0.02, 2e-3);
  EXPECT_NEAR(deviationOf(estimate.pose_covariance, 5), 0.5, 1e-2);
  EXPECT_NEAR(estimate.pose_covariance(1, 5), 0.0, 1e-3);
}

// Every second picture is dark and has no readings.
TEST(GroundMotion, AnOldVelocityBecomesLessCertain) {
  Flight flight(mounted(), 1e-6);
  flight.keyframe_every = 1;
  double before = 0.0, after = 0.0;
  for (int i = 0; i < 90; ++i) {
    const GroundEstimate& estimate = flight.step([&](GroundFrame& frame) {
      if (i > 30 && i % 2 == 0) {
        frame.answer.reset();
        frame.height.reset();
        frame.down.reset();
      }
    });
    if (i == 30) before = estimate.pose_covariance.topLeftCorner<2, 2>().trace();
    if (i > 31 && estimate.hasPose()) {
      EXPECT_FALSE(estimate.hasTwist());
      after = estimate.pose_covariance.topLeftCorner<2, 2>().trace();
      EXPECT_LT((estimate.base_to_odometry.translation() -
                 inOdometry(flight.base(i), flight.base(1)).position)
                    .head<2>()
                    .norm(),
                4.0 * std::sqrt(after) + 0.02)
          << i;
    }
  }
  EXPECT_GT(std::sqrt(after - before), 0.5);
}

TEST(GroundMotion, SetPoseMovesTheBase) {
  Flight flight(mounted(), 1e-5);
  flight.steps(30);
  Pose3 wanted = Pose3::Identity();
  wanted.translation() << 100.0, -50.0, 7.0;
  wanted.linear() = motion::rotationAbout(Eigen::Vector3d(0.0, 0.0, 1.2));
  Covariance6 covariance = Covariance6::Zero();
  covariance.diagonal() << 0.04, 0.09, 0.0, 0.0, 0.0, 0.01;
  flight.ground.setPose(wanted, covariance);
  const GroundEstimate at = flight.step();
  ASSERT_EQ(at.status, GroundStatus::ok);
  EXPECT_NEAR(at.base_to_odometry.translation().x(), 100.0, 1e-6);
  EXPECT_NEAR(at.base_to_odometry.translation().y(), -50.0, 1e-6);
  EXPECT_NEAR(at.base_to_odometry.translation().z(), flight.base(30).position.z(), 1e-3);
  EXPECT_NEAR(std::atan2(at.base_to_odometry.linear()(1, 0), at.base_to_odometry.linear()(0, 0)),
              1.2, 1e-6);
  EXPECT_NEAR(at.pose_covariance(0, 0), 0.04, 1e-2);
  EXPECT_NEAR(at.pose_covariance(5, 5), 0.01, 1e-3);
  for (int i = 31; i < 60; ++i) {
    const GroundEstimate& estimate = flight.step();
    ASSERT_EQ(estimate.status, GroundStatus::ok);
    const double moved =
        (estimate.base_to_odometry.translation() - at.base_to_odometry.translation()).norm();
    EXPECT_NEAR(moved, (flight.base(i).position - flight.base(30).position).norm(), 5e-3);
  }
  flight.ground.reset();
  EXPECT_EQ(flight.step().status, GroundStatus::started);
  covariance(0, 0) = -1.0;
  EXPECT_THROW(flight.ground.setPose(wanted, covariance), std::invalid_argument);
}

// The height stays as measured, so its scale error does, too.
TEST(GroundMotion, SetPoseDoesNotUseTheHeight) {
  Flight flight(mounted(), 1e-8);
  GroundMotionOptions options = optionsWith(mounted());
  options.scale_deviation = 0.02;
  flight.ground = GroundMotion(options);
  flight.steps(30);
  Pose3 wanted = Pose3::Identity();
  wanted.translation() << 100.0, -50.0, 70.0;
  flight.ground.setPose(wanted, Covariance6::Zero());
  const GroundEstimate& estimate = flight.step();
  const double height = estimate.base_to_odometry.translation().z();
  EXPECT_NEAR(height, flight.base(30).position.z(), 1e-3);
  EXPECT_NEAR(std::sqrt(estimate.pose_covariance(2, 2)), 0.02 * estimate.height, 1e-3);
}

TEST(GroundMotion, StampGoingBackRestarts) {
  Flight flight(mounted(), 1e-8);
  flight.steps(30);
  Flight looped(mounted(), 1e-8);
  EXPECT_EQ(flight.ground.add(looped.next()).status, GroundStatus::stamp_went_back);
  EXPECT_EQ(flight.ground.add(looped.next()).status, GroundStatus::started);
  EXPECT_EQ(flight.ground.add(looped.next()).status, GroundStatus::ok);
}

TEST(GroundMotion, ASingleStampThatWentBackChangesNothing) {
  Flight flight(mounted(), 1e-4);
  Flight undisturbed(mounted(), 1e-4);
  for (int i = 0; i < 40; ++i) {
    const GroundEstimate estimate = flight.step();
    EXPECT_EQ(estimate.twist, undisturbed.step().twist);
    if (i % 10 != 5) continue;
    GroundFrame wrong;
    wrong.stamp = flight.next().stamp - 100'000'000;
    undisturbed.next();
    EXPECT_EQ(flight.ground.add(wrong).status, GroundStatus::stamp_went_back);
  }
}

// Only its time is wrong, not what it shows: the odometry goes on. After an hour the matcher has no
// reference, so there is no homography.
TEST(GroundMotion, ASingleStampAheadDoesNotEndTheOdometry) {
  constexpr int kWrong = 25;  // no keyframe
  for (const std::int64_t ahead : {500'000'000LL, 3'600'000'000'000LL}) {
    const bool is_gap = ahead > 1'000'000'000;
    Flight flight(mounted(), 1e-8);
    Flight undisturbed(mounted(), 1e-8);
    for (int i = 0; i < 45; ++i) {
      const GroundEstimate right = undisturbed.step();
      const GroundEstimate estimate = flight.step([&](GroundFrame& frame) {
        if (i != kWrong) return;
        frame.stamp += ahead;
        if (is_gap) frame.answer.reset();
      });
      if (i == (is_gap ? kWrong : kWrong + 1)) {
        EXPECT_EQ(estimate.status,
                  is_gap ? GroundStatus::no_homography : GroundStatus::stamp_went_back);
        continue;
      }
      if (i == 0) continue;
      ASSERT_EQ(estimate.status, right.status) << i << ": " << toString(estimate.status);
      EXPECT_LT(
          (estimate.base_to_odometry.translation() - right.base_to_odometry.translation()).norm(),
          0.01)
          << i;
      if (!is_gap && (i == kWrong || i == kWrong + 2)) {
        EXPECT_EQ(estimate.has_twist, i == kWrong) << "the time since the one before is not known";
        continue;
      }
      ASSERT_EQ(estimate.hasTwist(), right.hasTwist()) << i;
      EXPECT_LT((estimate.twist - right.twist).norm(), 0.03) << i;  // of two frames after the gap
    }
  }
}

// Whoever takes SequenceMatch for a new frame although it is `repeated` gives it twice.
TEST(GroundMotion, TheSameFrameAgainHasTheSameEstimate) {
  Flight flight(mounted(), 1e-8);
  flight.steps(20);
  const GroundFrame frame = flight.next();
  const GroundEstimate once = flight.ground.add(frame);
  const GroundEstimate again = flight.ground.add(frame);
  EXPECT_EQ(again.status, GroundStatus::ok);
  EXPECT_EQ(again.twist, once.twist);
  EXPECT_EQ(flight.step().status, GroundStatus::ok);
}

std::string refusalOf(const std::function<void(GroundFrame&)>& change) {
  Flight flight(mounted(), 1e-8);
  flight.next();
  return test::refusalOf([&] { flight.step(change); });
}

TEST(GroundMotion, RefusesUnusableReadings) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  using Change = std::function<void(GroundFrame&)>;
  const std::vector<std::pair<std::string, Change>> changes{
      {"the height is 0.000000 m; expected a number above 0",
       [](GroundFrame& f) { f.height->metres = 0.0; }},
      {"the height is nan m; expected a number above 0",
       [](GroundFrame& f) { f.height->metres = kNan; }},
      {"the frame is its own reference; expected the stamp of an earlier one",
       [](GroundFrame& f) { f.reference_stamp = f.stamp; }},
      {"the height has a beam whose direction has a length of 2.000000; expected 1, or 0 for none",
       [](GroundFrame& f) { f.height->beam_direction << 0.0, 0.0, 2.0; }},
      {"the height", [](GroundFrame& f) { f.height->deviation = -1.0; }},
      {"the height", [](GroundFrame& f) { f.height->age = kNan; }},
      {"the", [](GroundFrame& f) { f.down->direction *= 2.0; }},
      {"the", [](GroundFrame& f) { f.down->direction(0) = kNan; }},
      {"the", [](GroundFrame& f) { f.down->deviation = kNan; }},
      {"the",
       [](GroundFrame& f) {
         f.turn = TurnReading{Eigen::Matrix3d::Zero(), 0.1};
       }},
      {"the rotation is not a rotation matrix",
       [](GroundFrame& f) {
         f.turn = TurnReading{Eigen::Vector3d(1.0, 1.0, -1.0).asDiagonal(), 0.1};
       }},
      {"the camera matrix is not upper triangular", [](GroundFrame& f) { f.camera.setZero(); }},
      {"fx of the camera matrix is 1; expected",
       [](GroundFrame& f) {
         f.camera.setIdentity();
         f.size = {640, 480};
       }},
      {"the", [](GroundFrame& f) { f.answer->homography(1, 1) = kNan; }}};
  for (const auto& [words, change] : changes) {
    EXPECT_EQ(refusalOf(change).find(words), 0U) << words << " | " << refusalOf(change);
  }
  EXPECT_EQ(refusalOf([](GroundFrame&) {}), "");
}

TEST(GroundMotion, RefusesAMountingThatMirrors) {
  GroundMotionOptions options = optionsWith(mounted());
  EXPECT_NO_THROW(GroundMotion{options});
  options.camera_to_base.linear().col(0) *= -1.0;
  test::expectRefused([&] { GroundMotion{options}; }, "camera_to_base is not a rotation");
}

TEST(GroundMotion, RefusesHomographiesThatNoPairOfImagesHas) {
  const auto moved = [](double x, double y) {
    return [=](GroundFrame& f) {
      f.size = {640, 480};
      f.answer->homography = Eigen::Matrix3d::Identity();
      f.answer->homography.topRightCorner<2, 1>() << x, y;
    };
  };
  const std::string apart =
      "the homography moves the whole reference out of the image; expected a part in common";
  for (const double far : {1e9, -1e9, 1e300, 700.0}) {
    EXPECT_EQ(refusalOf(moved(far, 0.0)), apart) << far;
    EXPECT_EQ(refusalOf(moved(0.0, far)), apart) << far;
  }
  EXPECT_EQ(refusalOf(moved(600.0, 400.0)), "");
  const std::string flat = "the homography mirrors the image, or makes it a line";
  EXPECT_EQ(refusalOf([](GroundFrame& f) {
              f.answer->homography = Eigen::Vector3d(-1, 1, 1).asDiagonal();
            }),
            flat);
  EXPECT_EQ(refusalOf([](GroundFrame& f) { f.answer->homography.setZero(); }), flat);
  EXPECT_EQ(refusalOf([](GroundFrame& f) { f.answer->homography.row(1).setZero(); }), flat);
}

TEST(GroundMotion, WithoutHeightOrCovarianceNothingIsKnown) {
  Flight flight(mounted(), 1e-8);
  flight.gives_height = false;
  flight.next();
  EXPECT_EQ(flight.step().status, GroundStatus::no_height);
  flight.gives_height = true;
  const auto forget = [](auto& f) { f.answer->covariance(3, 3) = std::nan(""); };
  EXPECT_EQ(flight.step(forget).status, GroundStatus::no_covariance);
}

TEST(GroundMotion, BeamMissingTheGroundGivesNoHeight) {
  for (const double down : {-1.0, 0.0, 0.05}) {  // share of the beam along the optical axis
    const auto turned = [down](GroundFrame& frame) {
      frame.height->beam_direction << std::sqrt(1.0 - down * down), 0.0, down;
    };
    Flight level(downward(), 3e-5);
    level.next();
    const GroundEstimate& first = level.step(turned);
    EXPECT_EQ(first.status, GroundStatus::no_height) << down;
    EXPECT_GT(first.height_misfit, GroundEstimate::kContradiction);
    level.steps(30);
    const GroundEstimate& estimate = level.step(turned);
    EXPECT_EQ(estimate.status, GroundStatus::ok);
    EXPECT_FALSE(estimate.height_used);
    EXPECT_GT(estimate.height_misfit, GroundEstimate::kContradiction);
    EXPECT_NEAR(estimate.height, level.truth(32).position.z(), 0.03);
  }
}

TEST(GroundMotion, AllocatesNothingInTheSteadyState) {
  Flight flight(mounted(), 3e-5);
  flight.steps(30);
  std::vector<GroundFrame> frames;
  for (int i = 0; i < 30; ++i) frames.push_back(flight.next());
  const test::AllocationCounter counter;
  for (const GroundFrame& frame : frames) flight.ground.add(frame);
  EXPECT_EQ(counter.count(), 0U);
}

}  // namespace
}  // namespace ktgp_orb
