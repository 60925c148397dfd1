// For any references of the frames, the path gives the map from any frame to any other.
#include "ktgp_orb/frame_path.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <stdexcept>

namespace ktgp_orb {
namespace {

/// World -> frame `i` of a camera that turns, moves on and tilts.
Eigen::Matrix3d pose(int i) {
  const double t = 0.02 * i;
  Eigen::Matrix3d h;
  h << std::cos(t), -std::sin(t), 5.0 * i, std::sin(t), std::cos(t), 40.0 * std::sin(3.0 * t),
      1e-5 * std::sin(2.0 * t), 2e-5 * std::cos(t), 1.0;
  return h;
}

Eigen::Matrix3d between(int from, int to) {
  const Eigen::Matrix3d h = pose(to) * pose(from).inverse();
  return h / h(2, 2);
}

void expectSame(const Eigen::Matrix3d& actual, const Eigen::Matrix3d& expected) {
  for (const Eigen::Vector2d& p : {Eigen::Vector2d(0, 0), Eigen::Vector2d(639, 0),
                                   Eigen::Vector2d(639, 479), Eigen::Vector2d(0, 479)}) {
    const Eigen::Vector2d a = (actual * p.homogeneous()).hnormalized();
    const Eigen::Vector2d b = (expected * p.homogeneous()).hnormalized();
    EXPECT_LT((a - b).norm(), 1e-6);
  }
}

TEST(FramePath, IsTheProductOfItsSteps) {
  FramePath path(100);
  EXPECT_FALSE(path.add(0, 0, std::nullopt));
  for (int i = 1; i < 50; ++i) EXPECT_TRUE(path.add(i, i - 1, between(i - 1, i)));
  expectSame(*path.between(3, 40), between(3, 40));
  expectSame(*path.between(40, 3), between(40, 3));
  EXPECT_FALSE(path.between(3, 50));
}

TEST(FramePath, TakesKeyframesAndAFixedReference) {
  FramePath keyframes(10);  // shorter than a keyframe is used
  FramePath fixed(10);
  keyframes.add(0, 0, std::nullopt);
  for (int i = 1; i < 90; ++i) {
    const int keyframe = (i - 1) / 30 * 30;
    EXPECT_TRUE(keyframes.add(i, keyframe, between(keyframe, i)));
    EXPECT_EQ(fixed.add(i, 0, between(0, i)), i > 1);
  }
  expectSame(*keyframes.between(85, 89), between(85, 89));
  expectSame(*fixed.between(81, 88), between(81, 88));
  expectSame(*fixed.between(0, 88), between(0, 88));
  EXPECT_FALSE(fixed.between(20, 88)) << "longer ago than it remembers";
}

TEST(FramePath, StartsAnewWithoutHomographyOrWithAnUnknownReference) {
  FramePath path(10);
  path.add(0, 0, std::nullopt);
  EXPECT_TRUE(path.add(1, 0, between(0, 1)));
  EXPECT_FALSE(path.add(2, 1, std::nullopt));
  EXPECT_FALSE(path.between(1, 2));
  EXPECT_TRUE(path.add(3, 2, between(2, 3)));
  EXPECT_FALSE(path.add(9, 8, between(8, 9)));
  EXPECT_FALSE(path.between(3, 9));
  expectSame(*path.between(8, 9), between(8, 9));
  EXPECT_FALSE(path.add(10, 9, Eigen::Matrix3d::Zero())) << "no homography at all";
  EXPECT_FALSE(path.add(11, 10, Eigen::Matrix3d::Constant(std::nan(""))));
}

TEST(FramePath, DoesNotWearOutOnALongFlight) {
  FramePath path(5);
  const Eigen::Matrix3d step = between(0, 1);
  path.add(0, 0, std::nullopt);
  for (int i = 1; i < 200000; ++i) ASSERT_TRUE(path.add(i, i - 1, step));
  expectSame(*path.between(199997, 199999), step * step);
}

TEST(FramePath, HasAtLeastOneFrame) {
  EXPECT_THROW(FramePath(0), std::invalid_argument);
}

}  // namespace
}  // namespace ktgp_orb
