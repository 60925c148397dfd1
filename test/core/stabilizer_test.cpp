// Compares the steady picture with the camera's true path: removes shake, keeps the path, shows no
// border.
#include "ktgp_orb/stabilizer.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <cstdio>
#include <opencv2/calib3d.hpp>
#include <random>
#include <stdexcept>

#include "rolling_camera.h"
#include "shaking_flight.h"

namespace ktgp_orb {
namespace {

const cv::Size kSize(640, 480);
constexpr std::int64_t kPeriod = 33'000'000;  // ns

using test::Path;

Eigen::Matrix3d step(const Path& path, std::size_t i) {
  const Eigen::Matrix3d h = path[i] * path[i - 1].inverse();
  return h / h(2, 2);
}

std::vector<SteadyFrame> stabilized(const Path& path, const StabilizerOptions& options) {
  Stabilizer stabilizer(options);
  std::vector<SteadyFrame> ready;
  for (std::size_t i = 0; i < path.size(); ++i) {
    const std::optional<Eigen::Matrix3d> h =
        i == 0 ? std::nullopt : std::make_optional(step(path, i));
    const auto stamp = static_cast<std::int64_t>(i) * kPeriod;
    stabilizer.add(stamp, stamp - kPeriod, h, kSize, ready);
    EXPECT_EQ(ready.size(), i + 1 > static_cast<std::size_t>(options.lag)
                                ? i + 1 - static_cast<std::size_t>(options.lag)
                                : 0U);
  }
  stabilizer.flush(ready);
  return ready;
}

/// Shake of the path in the steady picture, from frame `first` on.
double shakeAfter(const Path& path, const std::vector<SteadyFrame>& steady, std::size_t first) {
  std::vector<Eigen::Matrix3d> steps;
  for (std::size_t i = first; i < path.size(); ++i) {
    steps.emplace_back(steady[i].warp * step(path, i) * steady[i - 1].warp.inverse());
  }
  return shakeOf(steps, kSize);
}

double shakeBefore(const Path& path, std::size_t first) {
  std::vector<Eigen::Matrix3d> steps;
  for (std::size_t i = first; i < path.size(); ++i) steps.push_back(step(path, i));
  return shakeOf(steps, kSize);
}

Eigen::Vector2d centre(const Eigen::Matrix3d& warp) {
  return (warp * Eigen::Vector3d(319.5, 239.5, 1.0)).hnormalized();
}

TEST(Stabilizer, TakesTheShakeOut) {
  const Path path = test::shakingFlight(200, 3.0);
  const double before = shakeBefore(path, 30);
  StabilizerOptions options;
  const auto causal = stabilized(path, options);
  ASSERT_EQ(causal.size(), path.size());
  EXPECT_LT(shakeAfter(path, causal, 30), 0.08 * before);
  options.lag = 15;
  EXPECT_LT(shakeAfter(path, stabilized(path, options), 30), 0.01 * before);
}

/// Moves by 7 px from frame to frame.
Path evenMotion() {
  Path path;
  for (int i = 0; i < 60; ++i) {
    path.push_back(Eigen::Matrix3d::Identity());
    path.back()(0, 2) = 7.0 * i;
  }
  return path;
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
  const auto steady = stabilized(evenMotion(), {});
  for (std::size_t i = 0; i < steady.size(); ++i) {
    const double delay = (centre(steady[i].warp) - Eigen::Vector2d(319.5, 239.5)).norm();
    EXPECT_LT(delay, i < 40 ? 1.25 * 30.0 : 1.25 * 7.0 * 0.35) << i;
    EXPECT_NEAR(steady[i].warp(0, 0), 1.0 / 0.8, 1e-9);
  }
}

// The line through the first two or three frames of a path points anywhere.
TEST(Stabilizer, IsSteadyFromTheFirstFramesOn) {
  const Path path = test::shakingFlight(20, 3.0, 0.0);
  EXPECT_LT(shakeAfter(path, stabilized(path, {}), 1), 0.15 * shakeBefore(path, 1));
}

TEST(Stabilizer, NeverShowsWhatIsBeyondTheBorder) {
  for (const double shake : {3.0, 30.0, 200.0}) {
    for (const double max_crop : {0.02, 0.1, 0.3}) {
      StabilizerOptions options;
      options.max_crop = max_crop;
      options.lag = 5;
      for (const SteadyFrame& frame : stabilized(test::shakingFlight(120, shake), options)) {
        ASSERT_LT(test::beyondBorder(frame.warp), 1e-6) << shake << ' ' << max_crop;
      }
    }
  }
}

TEST(Stabilizer, StartsAnewGentlyWithoutAHomography) {
  const Path path = test::shakingFlight(120, 4.0);
  Stabilizer stabilizer;
  std::vector<SteadyFrame> ready;
  for (std::size_t i = 0; i < path.size(); ++i) {
    const bool lost = i == 0 || i == 60 || i == 61;
    const auto stamp = static_cast<std::int64_t>(i) * kPeriod;
    stabilizer.add(stamp, stamp - kPeriod, lost ? std::nullopt : std::make_optional(step(path, i)),
                   kSize, ready);
  }
  ASSERT_EQ(ready.size(), path.size());
  for (std::size_t i = 0; i < ready.size(); ++i) {
    EXPECT_EQ(ready[i].starts_anew, i == 0 || i == 60 || i == 61) << i;
  }
  // The last correction is kept at first and fades out: the view does not jump.
  const Eigen::Vector2d before = centre(ready[59].warp);
  ASSERT_GT((before - Eigen::Vector2d(319.5, 239.5)).norm(), 1.0) << "nothing to jump from";
  EXPECT_LT((centre(ready[60].warp) - before).norm(), 0.2);
}

TEST(Stabilizer, GivesEachFrameOnceWhateverTheLag) {
  const Path path = test::shakingFlight(50, 2.0);
  StabilizerOptions options;
  options.lag = 12;
  Stabilizer stabilizer(options);
  std::vector<SteadyFrame> ready;
  for (std::size_t i = 0; i < path.size(); ++i) {
    const auto stamp = static_cast<std::int64_t>(i) * kPeriod;
    const bool lost = i % 20 == 0;
    stabilizer.add(stamp, stamp - kPeriod, lost ? std::nullopt : std::make_optional(step(path, i)),
                   kSize, ready);
    if (lost && i > 0) {
      EXPECT_GE(ready.size(), i) << "nothing of the old path waits";
    }
  }
  stabilizer.flush(ready);
  ASSERT_EQ(ready.size(), path.size());
  for (std::size_t i = 0; i < ready.size(); ++i) {
    EXPECT_EQ(ready[i].stamp, static_cast<std::int64_t>(i) * kPeriod);
  }
}

TEST(Stabilizer, GivesTheSameWithAKeyframeAsReference) {
  const Path path = test::shakingFlight(80, 3.0, 0.5);
  const auto expected = stabilized(path, {});
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

TEST(Stabilizer, AnotherSizeStartsAnew) {
  Stabilizer stabilizer;
  std::vector<SteadyFrame> ready;
  stabilizer.add(1, 0, std::nullopt, kSize, ready);
  stabilizer.add(2, 1, Eigen::Matrix3d::Identity(), {320, 240}, ready);
  ASSERT_EQ(ready.size(), 2U);
  EXPECT_TRUE(ready[1].starts_anew);
}

/// Of a camera that pans by 60 px/s and trembles by 3 px and 0.2 degrees at 3 to 7 Hz: plane ->
/// image at a time, s.
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

/// What maps the points that an image shows to where the next one shows them.
Path stepsSeen(const test::RollingCamera& camera) {
  Path steps;
  for (int i = 1; i < kTrembling; ++i) {
    std::vector<cv::Point2d> from, to;
    for (const Eigen::Vector2d& point : camera.points((i - 0.5) * kSeconds)) {
      const Eigen::Vector2d before = camera.seen(point, (i - 1) * kSeconds);
      const Eigen::Vector2d now = camera.seen(point, i * kSeconds);
      from.emplace_back(before.x(), before.y());
      to.emplace_back(now.x(), now.y());
    }
    const cv::Matx33d h = cv::findHomography(from, to);
    steps.emplace_back(Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(h.val));
  }
  return steps;
}

/// Those of the middle rows, as if the shutter had been taken out.
Path stepsOfMiddleRows(const test::RollingCamera& camera) {
  Path steps;
  for (int i = 1; i < kTrembling; ++i) {
    steps.emplace_back(camera.view(i * kSeconds) * camera.view((i - 1) * kSeconds).inverse());
  }
  return steps;
}

/// Root mean square of the second difference of the points' paths in the steady picture, px.
double jitterOf(const test::RollingCamera& camera, const Path& steps) {
  Stabilizer stabilizer;
  std::vector<SteadyFrame> steady;
  for (int i = 0; i < kTrembling; ++i) {
    const std::int64_t stamp = i * kPeriod;
    stabilizer.add(stamp, stamp - kPeriod,
                   i == 0 ? std::nullopt : std::make_optional(steps.at(i - 1)), kSize, steady);
  }
  stabilizer.flush(steady);
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
TEST(Stabilizer, TakesOutMostOfWhatARollingShutterBends) {
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

TEST(Stabilizer, RefusesOptionsOutOfRange) {
  StabilizerOptions options;
  options.max_crop = 0.5;
  EXPECT_THROW(Stabilizer{options}, std::invalid_argument);
  options = {};
  options.lag = -1;
  EXPECT_THROW(Stabilizer{options}, std::invalid_argument);
  options = {};
  options.strength = std::nan("");
  EXPECT_THROW(Stabilizer{options}, std::invalid_argument);
}

TEST(Shake, IsTheMeanSquareOfTheSecondDifference) {
  const auto shift = [](double x) {
    Eigen::Matrix3d h = Eigen::Matrix3d::Identity();
    h(0, 2) = x;
    return h;
  };
  EXPECT_DOUBLE_EQ(shakeOf({shift(3.0), shift(5.0), shift(5.0)}, kSize), 2.0);
  EXPECT_EQ(shakeOf({shift(3.0)}, kSize), 0.0);
}

}  // namespace
}  // namespace ktgp_orb
