// Covariances of motions where the camera is not quite the given one: focal length, zoom, rolling
// shutter, and steps too small to be seen.

#include "two_view/shared_errors.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <optional>
#include <ostream>
#include <utility>
#include <vector>

#include "ktgp_orb/ktgp_matcher.h"
#include "ktgp_orb/two_view.h"
#include "world.h"

namespace ktgp_orb::two_view {
namespace {

// 99.9 % of chi² with three and with five degrees of freedom
constexpr double kBoundOfTurn = 16.27;
constexpr double kBoundOfMotion = 20.52;

TwoViewOptions realCameras() {
  TwoViewOptions options;
  options.shared_errors = SharedErrors::ofRealCameras();
  return options;
}

/// What the estimator is not told.
struct Fault {
  const char* name;
  double focal = 1.0;       ///< given focal length, as a multiple of the true one
  double zoom = 1.0;        ///< of the target image
  double pitch = 0.0;       ///< rad/s, with a shutter that reads an image in 30 ms
  double interval = 0.1;    ///< s between the images, if the camera pitches
  double principal = 0.0;   ///< error of the given principal point along x and along y, px
  double distortion = 0.0;  ///< of both images, px at the corners
};

World drawn(Shape shape, const Fault& fault, Numbers& numbers) {
  constexpr std::size_t kRight = 500;
  constexpr std::size_t kWrong = 100;
  constexpr double kNoise = 0.2;     // px, of aligned points
  constexpr double kReadout = 0.03;  // s
  Travel travel(shape, numbers);
  if (fault.pitch > 0.0) {
    travel.rotation =
        Eigen::AngleAxisd(fault.pitch * fault.interval, Eigen::Vector3d::UnitX()).matrix();
    travel.translation *= 2.5 * fault.interval;  // 1 to 2 m/s
    travel.readout = kReadout / fault.interval;
  }
  World world(shape, travel, numbers, kRight, kWrong, kNoise);
  const Eigen::Vector2d centre = camera().topRightCorner<2, 1>();
  for (Eigen::Vector2d& u : world.pairs.target) u = centre + fault.zoom * (u - centre);
  for (auto* points : {&world.pairs.reference, &world.pairs.target}) {
    for (Eigen::Vector2d& x : *points) x = distorted(x, fault.distortion);
  }
  return world;
}

struct Outcome {
  bool doubted;
  bool inside;   ///< the truth is within 99.9 % of the covariance
  double error;  ///< normalised squared error
};

/// A turn has no direction to be right about, so that a claimed one is wrong.
Outcome outcomeOf(const World& world, const TwoView& found) {
  if (found.status != Status::ok) return {true, true, 0.0};
  const bool turned = world.pose.translation.isZero(0.0);
  const bool as_turn = turned || found.geometry == Geometry::rotation;
  const double error = normalisedError(world, found, as_turn ? 3 : 5);
  const bool claimed = turned && found.geometry != Geometry::rotation;
  return {found.doubt != Doubt::none, error < (as_turn ? kBoundOfTurn : kBoundOfMotion) && !claimed,
          error};
}

struct Tally {
  int runs = 0;
  int honest = 0;
  double median = 0.0;  ///< of the normalised squared errors
};

Tally tallyOf(Shape shape, const Fault& fault, int runs) {
  Numbers numbers(41);
  TwoViewEstimator estimator(realCameras());
  TwoView result;
  std::vector<double> errors;
  Tally tally;
  for (; tally.runs < runs; ++tally.runs) {
    const World world = drawn(shape, fault, numbers);
    TwoViewInput input = world.input();
    input.reference_camera->topLeftCorner<2, 2>() *= fault.focal;
    input.reference_camera->topRightCorner<2, 1>().array() += fault.principal;
    estimator.estimate(world.pairs, input, result);
    const Outcome outcome = outcomeOf(world, result);
    tally.honest += outcome.inside || outcome.doubted;
    errors.push_back(outcome.error);
  }
  std::sort(errors.begin(), errors.end());
  tally.median = errors[errors.size() / 2];
  return tally;
}

TEST(SharedErrors, OfRealCamerasArePartOfPresetSlam) {
  EXPECT_EQ(MatcherOptions::slam().shared_errors, SharedErrors::ofRealCameras());
  EXPECT_GT(SharedErrors::ofRealCameras().readout, 0.0);
}

class Faulty : public testing::TestWithParam<Fault> {};

void PrintTo(const Fault& fault, std::ostream* out) {
  *out << fault.name;
}

TEST_P(Faulty, CameraHasTheTruthInItsCovarianceOrADoubt) {
  constexpr int kDraws = 100;
  for (const Shape shape : {Shape::depth, Shape::plane, Shape::turn, Shape::forward}) {
    const Tally tally = tallyOf(shape, GetParam(), kDraws);
    // A shutter bends what the epipolar geometry knows to a hundredth of a pixel: 97 % when the
    // bound was set, 2 % without the shared errors of a shutter and a zoom.
    const bool bent = GetParam().pitch > 0.0 && (shape == Shape::depth || shape == Shape::forward);
    // 5 % are five deviations of the focal length: 89 and 78 of 100 when the bound was set.
    const bool far_off = std::abs(GetParam().focal - 1.0) > 0.04 && shape == Shape::plane;
    const int least = far_off ? 70 : bent ? 93 : 98;
    EXPECT_GE(tally.honest, kDraws * least / 100) << "shape " << static_cast<int>(shape);
  }
}

INSTANTIATE_TEST_SUITE_P(
    SharedErrors, Faulty,
    testing::Values(Fault{"focal_1_percent", 1.01}, Fault{"focal_3_percent", 1.03},
                    Fault{"focal_less_3_percent", 0.97}, Fault{"focal_5_percent", 1.05},
                    Fault{"focal_less_5_percent", 0.95}, Fault{"zoom_0_3_percent", 1.0, 1.003},
                    Fault{"zoom_1_percent", 1.0, 1.01},
                    Fault{"pitch_20", 1.0, 1.0, 20.0 * kDegree, 0.033},
                    Fault{"pitch_60", 1.0, 1.0, 60.0 * kDegree, 0.033},
                    Fault{"pitch_20_slow", 1.0, 1.0, 20.0 * kDegree, 0.1},
                    Fault{"pitch_60_slow", 1.0, 1.0, 60.0 * kDegree, 0.1},
                    Fault{"principal_point_5_px", 1.0, 1.0, 0.0, 0.1, 5.0},
                    Fault{"distortion_1_px", 1.0, 1.0, 0.0, 0.1, 0.0, 1.0}),
    [](const auto& info) { return info.param.name; });

/// With linear errors alone the medians were 1.58, 1.16, 0.035 and 1.47; they are 0.24, 0.24, 0.005
/// and 0.26 with all errors. A turn of 4 degrees is known to 0.04 degrees if the focal length is
/// known to 1 %, whatever its residuals say.
TEST(SharedShifts, LeaveTheCovarianceOfAnExactCameraUseful) {
  constexpr int kDraws = 200;
  for (const auto& [shape, least] :
       {std::pair(Shape::depth, 0.16), std::pair(Shape::plane, 0.15), std::pair(Shape::turn, 0.003),
        std::pair(Shape::forward, 0.17)}) {
    const Tally tally = tallyOf(shape, {"exact"}, kDraws);
    EXPECT_GE(tally.median, least) << "shape " << static_cast<int>(shape);
    EXPECT_GE(tally.honest, kDraws * 98 / 100) << "shape " << static_cast<int>(shape);
  }
}

/// Returns the position of the reference point `x` if the focal length were `factor` times as long.
Eigen::Vector2d seenWith(double factor, const Eigen::Vector2d& x) {
  Eigen::Matrix3d k = camera();
  k.topLeftCorner<2, 2>() *= factor;
  return (k * camera().inverse() * x.homogeneous()).hnormalized();
}

TEST(SharedShifts, OfFocalLengthAndZoomEqualThoseOfSuchCameras) {
  Numbers numbers(44);
  SharedErrors errors;
  errors.linear = 0.5;
  errors.focal = 0.01;
  errors.zoom = 0.02;
  const World world(Shape::depth, numbers);
  const std::optional<Cameras> cameras(Cameras(camera(), camera()));
  const SharedShifts shifts(errors, world.pairs, world.input(), cameras);
  const SharedShifts without_k(errors, world.pairs, world.input(), std::nullopt);
  const Eigen::Matrix3d h = cameras->homographyOf(world.pose.rotation);
  const auto mapped = [&](const Eigen::Vector2d& x) -> Eigen::Vector2d {
    return (h * x.homogeneous()).hnormalized();
  };
  for (std::size_t i = 0; i < world.right; ++i) {
    const Eigen::Vector2d& x = world.pairs.reference[i];
    const Eigen::Vector2d& u = world.pairs.target[i];
    const auto columns = shifts.at(x, u);
    const Eigen::Vector2d focal = seenWith(1.0 + errors.focal, x) - x;
    EXPECT_LT((columns.col(6).head<2>() - focal).norm(), 1e-9);
    EXPECT_LT((columns.col(6).tail<2>() - (seenWith(1.0 + errors.focal, u) - u)).norm(), 1e-9);
    EXPECT_EQ(columns.col(7).head<2>().norm(), 0.0);
    EXPECT_LT((columns.col(7).tail<2>() - (seenWith(1.0 + errors.zoom, u) - u)).norm(), 1e-9);
    EXPECT_EQ(columns.rightCols<4>().norm(), 0.0);
    const Eigen::Vector2d relative =
        columns.col(6).tail<2>() - 0.5 * (mapped(x + focal) - mapped(x - focal));
    EXPECT_LT((shifts.at(x, u, h).col(6) - relative).norm(), 1e-2);
    EXPECT_EQ(without_k.at(x, u).rightCols<6>().norm(), 0.0);
    EXPECT_GT(without_k.at(x, u).leftCols<6>().norm(), 0.5 * errors.linear);
  }
}

TEST(SharedShifts, OfPrincipalPointAndDistortionEqualThoseOfSuchCameras) {
  Numbers numbers(46);
  SharedErrors errors;
  errors.principal_point = 0.01;
  errors.distortion = 0.7;
  const World world(Shape::depth, numbers);
  const std::optional<Cameras> cameras(Cameras(camera(), camera()));
  const SharedShifts shifts(errors, world.pairs, world.input(), cameras);
  const SharedShifts without_k(errors, world.pairs, world.input(), std::nullopt);
  for (std::size_t i = 0; i < world.right; ++i) {
    const Eigen::Vector2d& x = world.pairs.reference[i];
    const Eigen::Vector2d& u = world.pairs.target[i];
    const auto columns = shifts.at(x, u);
    EXPECT_LT((columns.col(8) - Eigen::Vector4d(5.0, 0.0, 5.0, 0.0)).norm(), 1e-9);
    EXPECT_LT((columns.col(9) - Eigen::Vector4d(0.0, 5.05, 0.0, 5.05)).norm(), 1e-9);
    EXPECT_LT((columns.col(10).head<2>() - (distorted(x, 0.7) - x)).norm(), 5e-3);
    EXPECT_LT((columns.col(10).tail<2>() - (distorted(u, 0.7) - u)).norm(), 5e-3);
    EXPECT_EQ(columns.leftCols<8>().norm() + columns.col(11).norm(), 0.0);
    EXPECT_EQ(without_k.at(x, u).norm(), 0.0);
  }
}

/// A camera that turned by a radian would blur an image that is read for a third of the time.
TEST(SharedShifts, OfAFastShutterAreLimited) {
  constexpr double kMost = 0.05 * 480.0;  // px; ten times as far without the limit
  Numbers numbers(45);
  SharedErrors errors;
  errors.readout = 0.33;
  const World world(Shape::depth, numbers);
  const std::optional<Cameras> cameras(Cameras(camera(), camera()));
  const Eigen::Vector3d axes[] = {Eigen::Vector3d::UnitX(), Eigen::Vector3d::UnitZ()};
  for (const Eigen::Vector3d& axis : axes) {
    const SharedShifts shifts = SharedShifts(errors, world.pairs, world.input(), cameras)
                                    .with(Eigen::AngleAxisd(1.0, axis).toRotationMatrix());
    double most = 0.0;
    for (const Eigen::Vector2d& x : world.pairs.reference) {
      most = std::max(most, shifts.at(x, x).col(11).norm());
    }
    EXPECT_LT(most, kMost);
    EXPECT_GT(most, 1.0);
  }
}

TEST(SharedShifts, OfAShutterEqualThoseOfAMovingCamera) {
  Numbers numbers(43);
  SharedErrors errors;
  errors.readout = 0.02;
  for (int run = 0; run < 50; ++run) {
    Travel travel(randomRotation(0.05, numbers), 0.1 * randomVector(numbers));
    const std::optional<Cameras> cameras(Cameras(camera(), camera()));
    PointPairs pairs;
    std::vector<Eigen::Vector4d> moved;
    for (int i = 0; i < 50; ++i) {
      const Eigen::Vector2d x = numbers.pointIn(kSize);
      const Eigen::Vector3d p = numbers.uniform(4.0, 12.0) * camera().inverse() * x.homogeneous();
      Eigen::Vector4d still, read;
      travel.readout = 0.0;
      still << travel.seen(p, 0.0), travel.seen(p, 1.0);
      travel.readout = errors.readout;
      read << travel.seen(p, 0.0), travel.seen(p, 1.0);
      pairs.add(still.head<2>(), still.tail<2>(), 1.0);
      moved.push_back(read - still);
    }
    TwoViewInput input;
    input.reference_size = input.target_size = kSize;
    const SharedShifts shifts = SharedShifts(errors, pairs, input, cameras).with(travel.rotation);
    double off = 0.0;
    double all = 0.0;
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      const auto columns = shifts.at(pairs.reference[i], pairs.target[i]);
      off += (columns.col(11) - moved[i]).norm();
      all += moved[i].norm();
      EXPECT_EQ(columns.leftCols<8>().norm(), 0.0);
    }
    EXPECT_LT(off, 0.1 * all);
  }
}

struct SmallStep {
  double step;   ///< m
  double noise;  ///< px
  double least;  ///< degrees of the turn
  double most;
};

void checkRotations(const SmallStep& small) {
  constexpr int kDraws = 100;
  // The covariance of a rotation has the distance to the scene as its unit: the mean of 1 / depth
  // over the depths of Shape::far.
  const double inverse_depth = std::log(12.0 / 3.0) / (12.0 - 3.0);
  Numbers numbers(42);
  TwoViewEstimator estimator(realCameras());
  TwoView result;
  double sum = 0.0;
  int inside = 0;
  int runs = 0;
  int turns = 0;
  int step_inside = 0;
  for (int run = 0; run < kDraws; ++run) {
    const Eigen::Vector3d axis = randomVector(numbers).normalized();
    const Eigen::AngleAxisd turn(numbers.uniform(small.least, small.most) * kDegree, axis);
    const Travel travel(turn.matrix(), small.step * randomVector(numbers).normalized());
    const World world(Shape::far, travel, numbers, 500, 100, small.noise);
    estimator.estimate(world.pairs, world.input(), result);
    if (result.geometry != Geometry::rotation && result.geometry != Geometry::plane) continue;
    if (!result.pose_covariance.allFinite()) continue;  // claims nothing
    const double error = normalisedError(world, result, 3);
    inside += error < kBoundOfTurn;
    sum += error;
    ++runs;
    if (result.geometry != Geometry::rotation) continue;
    const Eigen::Vector3d step = inverse_depth * travel.translation;
    const Eigen::Matrix3d of_step = result.pose_covariance.topLeftCorner<3, 3>();
    step_inside += step.dot(of_step.inverse() * step) < kBoundOfTurn;
    ++turns;
  }
  EXPECT_GE(step_inside, turns * 99 / 100) << small.step << " m, " << small.noise << " px";
  // A step of 1 mm looks like a turn; one of 20 mm is seen where the noise is small.
  if (small.step < 0.0015) {
    EXPECT_GE(turns, kDraws / 2) << small.noise << " px";
  }
  EXPECT_GE(runs, kDraws / 2);
  EXPECT_GE(inside, runs * 99 / 100) << small.step << " m, " << small.noise << " px";
  EXPECT_LT(sum, 4.0 * runs) << small.step << " m, " << small.noise << " px";
}

/// A hand-held camera that turns by 1 to 5 degrees and moves by millimetres sees a parallax that it
/// cannot tell from noise.
TEST(SmallSteps, LeaveTheRotationWithinItsCovariance) {
  for (const double noise : {0.02, 0.2}) {
    for (const double step : {0.001, 0.002, 0.007, 0.012, 0.020}) {
      checkRotations({step, noise, 1.0, 5.0});
    }
  }
}

/// A turn of 0.05 degrees moves the pixels by half a pixel.
TEST(SmallSteps, LeaveATurnBelowHalfAPixelWithinItsCovariance) {
  for (const double noise : {0.02, 0.2}) {
    for (const double step : {0.0, 0.001, 0.007}) checkRotations({step, noise, 0.0, 0.05});
  }
}

}  // namespace
}  // namespace ktgp_orb::two_view
