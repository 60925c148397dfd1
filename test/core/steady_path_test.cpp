// The steadiest path over a whole recording: it removes the shake, never shows a border, survives
// cuts, gaps and large motions, and is the same wherever a long recording is divided.
#include "stabilization/steady_path.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>

#include "ktgp_orb/stabilizer.h"
#include "shaking_flight.h"

namespace ktgp_orb {
namespace {

const cv::Size kSize(640, 480);

using test::Path;
using Steps = std::vector<std::optional<Eigen::Matrix3d>>;

Steps stepsOf(const Path& path) {
  Steps steps(path.size());
  for (std::size_t i = 1; i < path.size(); ++i) {
    const Eigen::Matrix3d h = path[i] * path[i - 1].inverse();
    steps[i] = h / h(2, 2);
  }
  return steps;
}

/// Root mean square of the second difference of the corners' paths in the steady picture, px.
double jitterAfter(const Steps& steps, const Path& warps) {
  Path after;
  for (std::size_t i = 1; i < steps.size(); ++i) {
    if (steps[i]) after.emplace_back(warps[i] * *steps[i] * warps[i - 1].inverse());
  }
  return std::sqrt(shakeOf(after, kSize));
}

double jitterBefore(const Steps& steps) {
  Path before;
  for (const auto& step : steps) {
    if (step) before.push_back(*step);
  }
  return std::sqrt(shakeOf(before, kSize));
}

double beyondBorder(const Path& warps) {
  double worst = -1e9;
  for (const Eigen::Matrix3d& warp : warps) worst = std::max(worst, test::beyondBorder(warp));
  return worst;
}

using CornerMotion = Eigen::Matrix<double, 2, 4>;

/// What the path minimises: the absolute differences of the motion that remains at the corners of
/// the window, px; the first ones count 10 times, the second ones once, the third ones 100 times.
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

Path causal(const Steps& steps, const StabilizerOptions& options) {
  Stabilizer stabilizer(options);
  std::vector<SteadyFrame> ready;
  for (std::size_t i = 0; i < steps.size(); ++i) {
    const auto stamp = static_cast<std::int64_t>(i) * 33'000'000;
    stabilizer.add(stamp, stamp - 33'000'000, steps[i], kSize, ready);
  }
  stabilizer.flush(ready);
  Path warps;
  for (const SteadyFrame& frame : ready) warps.push_back(frame.warp);
  return warps;
}

class SteadyPath : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!hasSteadyPath()) GTEST_SKIP() << "built without Clp";
  }
};

// Steadier means a lower cost. The jitter alone is no measure: with lag 30 it is 0.05 px on each of
// these flights, over the whole recording 0.05 to 0.11 px.
TEST_F(SteadyPath, IsSteadierThanTheCausalOneWithTheLongestLag) {
  StabilizerOptions options;
  options.lag = 30;
  for (unsigned seed = 1; seed <= 8; ++seed) {
    const Steps steps = stepsOf(test::shakingFlight(200, 3.0, 4.0, seed));
    const Path whole = steadyPath(steps, kSize, 0.1);
    const double before = jitterBefore(steps);
    const double after = jitterAfter(steps, whole);
    const double cost = costOf(steps, whole);
    const double cost_with_lag = costOf(steps, causal(steps, options));
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

TEST_F(SteadyPath, NeverShowsWhatIsBeyondTheBorder) {
  for (const double shake : {3.0, 30.0, 200.0}) {
    for (const double max_crop : {0.01, 0.1, 0.3, 0.4}) {
      const Path warps =
          steadyPath(stepsOf(test::shakingFlight(120, shake, 30.0)), kSize, max_crop);
      EXPECT_LT(beyondBorder(warps), 1e-6) << shake << ' ' << max_crop;
    }
  }
}

TEST_F(SteadyPath, CutsAndGapsBeginANewPathWithoutAJumpOfTheWindow) {
  Steps steps = stepsOf(test::shakingFlight(150, 3.0, 4.0));
  for (const std::size_t lost : {50, 51, 90}) steps[lost].reset();
  Eigen::Matrix3d mirrored = Eigen::Matrix3d::Identity();
  mirrored(0, 0) = -1.0;
  steps[120] = mirrored;
  steps[130] = Eigen::Matrix3d::Constant(std::nan(""));
  const Path warps = steadyPath(steps, kSize, 0.1);
  ASSERT_EQ(warps.size(), steps.size());
  EXPECT_LT(beyondBorder(warps), 1e-6);
  const Eigen::Vector3d centre(319.5, 239.5, 1.0);
  for (const std::size_t lost : {50, 51, 90, 120, 130}) {
    const Eigen::Vector2d jump =
        (warps[lost] * centre).hnormalized() - (warps[lost - 1] * centre).hnormalized();
    EXPECT_LT(jump.norm(), 1.0) << lost;
  }
  for (const std::size_t lost : {120, 130}) steps[lost].reset();
  EXPECT_LT(jitterAfter(steps, warps), 0.3 * jitterBefore(steps));
}

TEST_F(SteadyPath, ALongRecordingHasNoSeams) {
  const Steps steps = stepsOf(test::shakingFlight(800, 3.0, 2.0));
  const Path warps = steadyPath(steps, kSize, 0.1);
  EXPECT_LT(beyondBorder(warps), 1e-6);
  for (std::size_t begin = 0; begin + 50 <= steps.size(); begin += 50) {
    const auto at = static_cast<std::ptrdiff_t>(begin);
    const Steps part(steps.begin() + at, steps.begin() + at + 50);
    const Path its(warps.begin() + at, warps.begin() + at + 50);
    EXPECT_LT(jitterAfter(part, its), 0.05 * jitterBefore(part)) << "from frame " << begin;
  }
}

TEST_F(SteadyPath, IsTheSameEveryTime) {
  const Steps steps = stepsOf(test::shakingFlight(100, 10.0, 5.0));
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
