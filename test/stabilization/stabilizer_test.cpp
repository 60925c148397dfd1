// The steady picture beside the camera's true path, from frame to frame and over a whole recording:
// removes shake, keeps the path, shows no border.
#include "ktgp_orb/stabilizer.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <opencv2/calib3d.hpp>
#include <random>
#include <stdexcept>
#include <vector>

#include "rolling_camera.h"
#include "stabilization/steady_path.h"
#include "synthetic_pairs.h"

namespace ktgp_orb {
namespace {

const cv::Size kSize(640, 480);
constexpr std::int64_t kPeriod = 33'000'000;  // ns

using Path = std::vector<Eigen::Matrix3d>;  ///< world -> frame

/// A camera that pans, turns and sways slowly, with `shake` px of random jitter on top.
Path shakingFlight(int frames, double shake, double pan = 4.0, unsigned seed = 1) {
  std::mt19937 random(seed);
  std::normal_distribution<double> jitter(0.0, 1.0);
  Path path;
  for (int i = 0; i < frames; ++i) {
    const double t = i / 30.0;
    const double angle = 0.1 * std::sin(0.8 * t) + shake * 0.002 * jitter(random);
    Eigen::Matrix3d h;
    h << std::cos(angle), -std::sin(angle), pan * i + shake * jitter(random), std::sin(angle),
        std::cos(angle), 30.0 * std::sin(1.1 * t) + shake * jitter(random), 0.0, 1e-5 * std::sin(t),
        1.0;
    path.push_back(h);
  }
  return path;
}

/// Largest distance that the picture shows beyond the border of the frame, px; negative: it stays
/// inside.
double beyondBorder(const Eigen::Matrix3d& warp) {
  double worst = -1e9;
  for (const Eigen::Vector2d& p : test::corners(kSize)) {
    const Eigen::Vector2d q = (warp.inverse() * p.homogeneous()).hnormalized();
    worst = std::max({worst, -q.x(), -q.y(), q.x() - 639.0, q.y() - 479.0});
  }
  return worst;
}

using Steps = std::vector<std::optional<Eigen::Matrix3d>>;  // the first frame has none

Steps stepsOf(const Path& path) {
  Steps steps(path.size());
  for (std::size_t i = 1; i < path.size(); ++i) {
    const Eigen::Matrix3d h = path[i] * path[i - 1].inverse();
    steps[i] = h / h(2, 2);
  }
  return steps;
}

/// Each frame comes once: after the lag, or when the path begins anew.
std::vector<SteadyFrame> stabilized(const Steps& steps, const StabilizerOptions& options = {}) {
  Stabilizer stabilizer(options);
  std::vector<SteadyFrame> ready;
  std::size_t first = 0;  // first frame of the path
  for (std::size_t i = 0; i < steps.size(); ++i) {
    const auto stamp = static_cast<std::int64_t>(i) * kPeriod;
    stabilizer.add(stamp, stamp - kPeriod, steps[i], kSize, ready);
    if (!steps[i]) first = i;
    const std::size_t waiting = std::min(static_cast<std::size_t>(options.lag), i + 1 - first);
    EXPECT_EQ(ready.size(), i + 1 - waiting);
  }
  stabilizer.flush(ready);
  EXPECT_EQ(ready.size(), steps.size());
  return ready;
}

Path warpsOf(const std::vector<SteadyFrame>& frames) {
  Path warps;
  for (const SteadyFrame& frame : frames) warps.push_back(frame.warp);
  return warps;
}

/// Shake of the path in the steady picture, from frame `first` on.
double shakeAfter(const Steps& steps, const Path& warps, std::size_t first = 1) {
  Path after;
  for (std::size_t i = first; i < steps.size(); ++i) {
    if (steps[i]) after.emplace_back(warps[i] * *steps[i] * warps[i - 1].inverse());
  }
  return shakeOf(after, kSize);
}

double shakeBefore(const Steps& steps, std::size_t first = 1) {
  return shakeAfter(steps, Path(steps.size(), Eigen::Matrix3d::Identity()), first);
}

double beyondBorder(const Path& warps) {
  double worst = -1e9;
  for (const Eigen::Matrix3d& warp : warps) worst = std::max(worst, beyondBorder(warp));
  return worst;
}

Eigen::Vector2d centre(const Eigen::Matrix3d& warp) {
  return (warp * Eigen::Vector3d(319.5, 239.5, 1.0)).hnormalized();
}

TEST(Stabilizer, TakesTheShakeOut) {
  const Steps steps = stepsOf(shakingFlight(200, 3.0));
  const double before = shakeBefore(steps, 30);
  StabilizerOptions options;
  EXPECT_LT(shakeAfter(steps, warpsOf(stabilized(steps, options)), 30), 0.08 * before);
  options.lag = 15;
  EXPECT_LT(shakeAfter(steps, warpsOf(stabilized(steps, options)), 30), 0.01 * before);
}

/// Moves by 7 px from frame to frame.
Steps evenMotion() {
  Steps steps(60, test::translation(7.0, 0.0));
  steps[0].reset();
  return steps;
}

TEST(Stabilizer, FollowsAnEvenMotionWithoutDelayAndAddsNothing) {
  StabilizerOptions options;
  options.lag = 1;
  for (const SteadyFrame& frame : stabilized(evenMotion(), options)) {
    EXPECT_LT((centre(frame.warp) - Eigen::Vector2d(319.5, 239.5)).norm(), 1e-6);
    EXPECT_NEAR(frame.warp(0, 0), 1.0 / 0.8, 1e-9) << "crops a tenth at each border";
  }
}

TEST(Stabilizer, WithoutLaterFramesFollowsAnEvenMotionWithAThirdOfAFrameDelay) {
  const auto steady = stabilized(evenMotion());
  for (std::size_t i = 0; i < steady.size(); ++i) {
    const double delay = (centre(steady[i].warp) - Eigen::Vector2d(319.5, 239.5)).norm();
    EXPECT_LT(delay, i < 40 ? 1.25 * 30.0 : 1.25 * 7.0 * 0.35) << i;
    EXPECT_NEAR(steady[i].warp(0, 0), 1.0 / 0.8, 1e-9);
  }
}

// The line through the first two or three frames of a path points anywhere.
TEST(Stabilizer, IsSteadyFromTheFirstFramesOn) {
  const Steps steps = stepsOf(shakingFlight(20, 3.0, 0.0));
  EXPECT_LT(shakeAfter(steps, warpsOf(stabilized(steps))), 0.15 * shakeBefore(steps));
}

TEST(Stabilizer, NeverShowsTheBorder) {
  for (const double shake : {3.0, 30.0, 200.0}) {
    for (const double max_crop : {0.02, 0.1, 0.3}) {
      StabilizerOptions options;
      options.max_crop = max_crop;
      options.lag = 5;
      const auto steady = stabilized(stepsOf(shakingFlight(120, shake)), options);
      EXPECT_LT(beyondBorder(warpsOf(steady)), 1e-6) << shake << ' ' << max_crop;
    }
  }
}

TEST(Stabilizer, StartsAnewGentlyWithoutAHomography) {
  Steps steps = stepsOf(shakingFlight(120, 4.0));
  for (const std::size_t lost : {60, 61}) steps[lost].reset();
  const std::vector<SteadyFrame> ready = stabilized(steps);
  ASSERT_EQ(ready.size(), steps.size());
  for (std::size_t i = 0; i < ready.size(); ++i) EXPECT_EQ(ready[i].starts_anew, !steps[i]) << i;
  // The last correction is kept at first and fades out: the view does not jump.
  const Eigen::Vector2d before = centre(ready[59].warp);
  ASSERT_GT((before - Eigen::Vector2d(319.5, 239.5)).norm(), 1.0) << "nothing to jump from";
  EXPECT_LT((centre(ready[60].warp) - before).norm(), 0.2);
}

TEST(Stabilizer, GivesEachFrameOnceWhateverTheLag) {
  Steps steps = stepsOf(shakingFlight(50, 2.0));
  for (const std::size_t lost : {20, 40}) steps[lost].reset();
  StabilizerOptions options;
  options.lag = 12;
  const std::vector<SteadyFrame> ready = stabilized(steps, options);
  ASSERT_EQ(ready.size(), steps.size());
  for (std::size_t i = 0; i < ready.size(); ++i) {
    EXPECT_EQ(ready[i].stamp, static_cast<std::int64_t>(i) * kPeriod);
  }
}

TEST(Stabilizer, GivesTheSameWithAKeyframeAsReference) {
  const Path path = shakingFlight(80, 3.0, 0.5);
  const auto expected = stabilized(stepsOf(path));
  Stabilizer stabilizer;
  std::vector<SteadyFrame> ready;
  for (std::size_t i = 0; i < path.size(); ++i) {
    std::optional<Eigen::Matrix3d> h;
    const std::size_t keyframe = i == 0 ? 0 : (i - 1) / 25 * 25;
    if (i > 0) h = path[i] * path[keyframe].inverse();
    stabilizer.add(static_cast<std::int64_t>(i) * kPeriod,
                   static_cast<std::int64_t>(keyframe) * kPeriod, h, kSize, ready);
  }
  ASSERT_EQ(ready.size(), expected.size());
  for (std::size_t i = 0; i < ready.size(); ++i) {
    EXPECT_TRUE(ready[i].warp.isApprox(expected[i].warp, 1e-9)) << i;
  }
}

TEST(Stabilizer, AHomographyOfZerosIsNone) {
  const Steps whole = stepsOf(shakingFlight(30, 2.0));
  Steps zeros = whole;
  Steps without = whole;
  zeros[15] = Eigen::Matrix3d::Zero();
  without[15].reset();
  StabilizerOptions options;
  options.lag = 3;
  const std::vector<SteadyFrame> expected = stabilized(without, options);
  Stabilizer stabilizer(options);
  std::vector<SteadyFrame> ready;
  for (std::size_t i = 0; i < zeros.size(); ++i) {
    const auto stamp = static_cast<std::int64_t>(i) * kPeriod;
    stabilizer.add(stamp, stamp - kPeriod, zeros[i], kSize, ready);
  }
  stabilizer.flush(ready);
  ASSERT_EQ(ready.size(), expected.size());
  for (std::size_t i = 0; i < ready.size(); ++i) {
    EXPECT_EQ(ready[i].starts_anew, i == 0 || i == 15) << i;
    EXPECT_EQ(ready[i].warp, expected[i].warp) << i;
  }
}

TEST(Stabilizer, AnotherSizeStartsAnew) {
  Stabilizer stabilizer;
  std::vector<SteadyFrame> ready;
  stabilizer.add(1, 0, std::nullopt, kSize, ready);
  stabilizer.add(2, 1, Eigen::Matrix3d::Identity(), {320, 240}, ready);
  ASSERT_EQ(ready.size(), 2U);
  EXPECT_TRUE(ready[1].starts_anew);
}

/// Homography of a camera that pans by 60 px/s and trembles by 3 px and 0.2 degrees at 3 to 7 Hz:
/// plane -> image at a time, s.
Eigen::Matrix3d trembling(double seconds) {
  const auto wave = [&](double hertz, double phase) {
    return std::sin(2.0 * M_PI * hertz * seconds + phase);
  };
  const double turn = 0.0035 * wave(5.3, 1.0);
  const Eigen::Vector2d middle(319.5, 239.5);
  Eigen::Affine2d view = Eigen::Affine2d::Identity();
  view.translate(middle).rotate(turn).translate(-middle);
  view.translate(Eigen::Vector2d(-60.0 * seconds + 3.0 * wave(7.1, 0.0) + 2.0 * wave(3.3, 2.0),
                                 3.0 * wave(6.2, 3.0) + 2.0 * wave(4.1, 1.0)));
  return view.matrix();
}

constexpr double kSeconds = 1e-9 * kPeriod;
constexpr int kTrembling = 150;  // images

/// Map from the points of an image to the points of the next one.
Steps stepsSeen(const test::RollingCamera& camera) {
  Steps steps(1);
  for (int i = 1; i < kTrembling; ++i) {
    std::vector<cv::Point2d> from, to;
    for (const Eigen::Vector2d& point : camera.points((i - 0.5) * kSeconds)) {
      const Eigen::Vector2d before = camera.seen(point, (i - 1) * kSeconds);
      const Eigen::Vector2d now = camera.seen(point, i * kSeconds);
      from.emplace_back(before.x(), before.y());
      to.emplace_back(now.x(), now.y());
    }
    const cv::Matx33d h = cv::findHomography(from, to);
    steps.push_back(Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(h.val));
  }
  return steps;
}

/// Homographies of the middle rows, as if the shutter had been taken out.
Steps stepsOfMiddleRows(const test::RollingCamera& camera) {
  Path views;
  for (int i = 0; i < kTrembling; ++i) views.push_back(camera.view(i * kSeconds));
  return stepsOf(views);
}

/// Root mean square of the second difference of the points' paths in the steady picture, px.
double jitterOf(const test::RollingCamera& camera, const Steps& steps) {
  const std::vector<SteadyFrame> steady = stabilized(steps);
  double sum = 0.0;
  int count = 0;
  for (int i = 30; i < kTrembling; ++i) {
    for (const Eigen::Vector2d& point : camera.points((i - 1) * kSeconds)) {
      const auto at = [&](int k) {
        const Eigen::Vector2d seen = camera.seen(point, k * kSeconds);
        return Eigen::Vector2d((steady.at(k).warp * seen.homogeneous()).hnormalized());
      };
      sum += (at(i) - 2.0 * at(i - 1) + at(i - 2)).squaredNorm();
      ++count;
    }
  }
  return std::sqrt(sum / count);
}

// A rolling shutter bends the picture. The homographies of what is seen have most of that, so the
// stabilizer takes it out; those of the middle rows, with the shutter taken out, would leave it in.
TEST(Stabilizer, RemovesMostOfARollingShutter) {
  const test::RollingCamera global{trembling, 0.0, kSize};
  const double jitter = jitterOf(global, stepsSeen(global));
  for (const double readout : {0.016, 0.03}) {
    const test::RollingCamera rolling{trembling, readout, kSize};
    const double bent = jitterOf(rolling, stepsSeen(rolling));
    const double corrected = jitterOf(rolling, stepsOfMiddleRows(rolling));
    std::printf(
        "readout %.0f ms: jitter %.3f px, of a global shutter %.3f px, by homographies of "
        "the middle rows %.3f px\n",
        1e3 * readout, bent, jitter, corrected);
    EXPECT_LT(bent, 3.0 * jitter) << readout;
    EXPECT_LT(bent, 0.3 * corrected) << readout;
  }
  EXPECT_LT(jitter, 0.25);
}

TEST(Shake, EqualsMeanSquareOfSecondDifference) {
  const auto shift = [](double x) { return test::translation(x, 0.0); };
  EXPECT_DOUBLE_EQ(shakeOf({shift(3.0), shift(5.0), shift(5.0)}, kSize), 2.0);
  EXPECT_EQ(shakeOf({shift(3.0)}, kSize), 0.0);
}

// The steadiest path over a whole recording: it also survives cuts, gaps and large motions, and is
// the same wherever a long recording is divided.

using CornerMotion = Eigen::Matrix<double, 2, 4>;

/// The cost that the path minimises: the absolute differences of the motion that remains at the
/// corners of the window, px; the first ones count 10 times, the second ones once, the third ones
/// 100 times.
double costOf(const Steps& steps, const Path& warps) {
  const auto corners_in = [&](std::size_t t) {
    CornerMotion found;
    for (int k = 0; k < 4; ++k) {
      const Eigen::Vector2d corner = test::corners(kSize)[static_cast<std::size_t>(k)];
      found.col(k) = (warps[t].inverse() * corner.homogeneous()).hnormalized();
    }
    return found;
  };
  std::vector<CornerMotion> motions;
  for (std::size_t t = 1; t < steps.size(); ++t) {
    const CornerMotion before = corners_in(t - 1);
    motions.emplace_back((*steps[t] * before.colwise().homogeneous()).colwise().hnormalized() -
                         corners_in(t));
  }
  double cost = 0.0;
  for (const double weight : {10.0, 1.0, 100.0}) {
    for (const CornerMotion& motion : motions) cost += weight * motion.cwiseAbs().sum();
    for (std::size_t t = 0; t + 1 < motions.size(); ++t) motions[t] = motions[t + 1] - motions[t];
    motions.pop_back();
  }
  return cost;
}

class SteadyPath : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!hasSteadyPath()) GTEST_SKIP() << "built without Clp";
  }
};

// Steadier means a lower cost. The jitter alone is no measure: with lag 30 it is 0.05 px on each of
// these flights, over the whole recording 0.05 to 0.11 px.
TEST_F(SteadyPath, SteadierThanCausalPathWithLongestLag) {
  StabilizerOptions options;
  options.lag = 30;
  for (unsigned seed = 1; seed <= 8; ++seed) {
    const Steps steps = stepsOf(shakingFlight(200, 3.0, 4.0, seed));
    const Path whole = steadyPath(steps, kSize, 0.1);
    const double before = std::sqrt(shakeBefore(steps));
    const double after = std::sqrt(shakeAfter(steps, whole));
    const double cost = costOf(steps, whole);
    const double cost_with_lag = costOf(steps, warpsOf(stabilized(steps, options)));
    std::printf("jitter: %.2f px before, %.3f after; cost %.0f, with lag 30 %.0f\n", before, after,
                cost, cost_with_lag);
    EXPECT_LT(after, 0.02 * before);
    EXPECT_LT(cost, cost_with_lag);
  }
}

TEST_F(SteadyPath, StandsStillAboveAShakingCamera) {
  Path still(90, Eigen::Matrix3d::Identity());
  std::mt19937 random(2);
  std::uniform_real_distribution<double> shift(-20.0, 20.0);
  for (auto& h : still) h.topRightCorner<2, 1>() << shift(random), shift(random);
  const Steps shaken = stepsOf(still);
  const Path warps = steadyPath(shaken, kSize, 0.1);
  for (std::size_t i = 1; i < warps.size(); ++i) {
    const Eigen::Matrix3d motion = warps[i] * *shaken[i] * warps[i - 1].inverse();
    EXPECT_TRUE((motion / motion(2, 2)).isApprox(Eigen::Matrix3d::Identity(), 1e-6)) << i;
  }
}

TEST_F(SteadyPath, NeverShowsTheBorder) {
  for (const double shake : {3.0, 30.0, 200.0}) {
    for (const double max_crop : {0.01, 0.1, 0.3, 0.4}) {
      const Path warps = steadyPath(stepsOf(shakingFlight(120, shake, 30.0)), kSize, max_crop);
      EXPECT_LT(beyondBorder(warps), 1e-6) << shake << ' ' << max_crop;
    }
  }
}

TEST_F(SteadyPath, CutsAndGapsBeginANewPathWithoutAJumpOfTheWindow) {
  Steps steps = stepsOf(shakingFlight(150, 3.0, 4.0));
  for (const std::size_t lost : {50, 51, 90}) steps[lost].reset();
  steps[120] = Eigen::Vector3d(-1.0, 1.0, 1.0).asDiagonal();
  steps[130] = Eigen::Matrix3d::Constant(std::nan(""));
  const Path warps = steadyPath(steps, kSize, 0.1);
  ASSERT_EQ(warps.size(), steps.size());
  EXPECT_LT(beyondBorder(warps), 1e-6);
  for (const std::size_t lost : {50, 51, 90, 120, 130}) {
    EXPECT_LT((centre(warps[lost]) - centre(warps[lost - 1])).norm(), 1.0) << lost;
  }
  for (const std::size_t lost : {120, 130}) steps[lost].reset();
  EXPECT_LT(shakeAfter(steps, warps), 0.09 * shakeBefore(steps));
}

TEST_F(SteadyPath, LongRecordingHasNoSeams) {
  const Steps steps = stepsOf(shakingFlight(800, 3.0, 2.0));
  const Path warps = steadyPath(steps, kSize, 0.1);
  EXPECT_LT(beyondBorder(warps), 1e-6);
  for (std::size_t begin = 0; begin + 50 <= steps.size(); begin += 50) {
    const auto at = static_cast<std::ptrdiff_t>(begin);
    const Steps part(steps.begin() + at, steps.begin() + at + 50);
    const Path its(warps.begin() + at, warps.begin() + at + 50);
    EXPECT_LT(shakeAfter(part, its), 0.0025 * shakeBefore(part)) << "from frame " << begin;
  }
}

TEST_F(SteadyPath, Deterministic) {
  const Steps steps = stepsOf(shakingFlight(100, 10.0, 5.0));
  const Path first = steadyPath(steps, kSize, 0.1);
  const Path second = steadyPath(steps, kSize, 0.1);
  for (std::size_t i = 0; i < first.size(); ++i) EXPECT_EQ(first[i], second[i]) << i;
}

TEST_F(SteadyPath, TakesAnyNumberOfFrames) {
  EXPECT_TRUE(steadyPath({}, kSize, 0.1).empty());
  for (const std::size_t count : {1, 2, 3, 4}) {
    EXPECT_EQ(steadyPath(Steps(count), kSize, 0.1).size(), count);
    EXPECT_EQ(steadyPath(Steps(count), {1, 1}, 0.1).size(), count);
  }
  EXPECT_THROW(steadyPath({}, kSize, 0.5), std::invalid_argument);
  EXPECT_THROW(steadyPath({}, kSize, std::nan("")), std::invalid_argument);
}

}  // namespace
}  // namespace ktgp_orb
