// Compares the search near predicted positions with its definition, pair by pair.

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "allocation_counter.h"
#include "core/knn/near_search.h"
#include "instruction_sets.h"
#include "ktgp_orb/knn_matcher.h"
#include "plain_search.h"

namespace ktgp_orb::knn {
namespace {

using test::same;
using util::ThreadPool;

const cv::Size kSize(640, 480);

Features makeFeatures(int count, std::uint32_t seed) {
  return test::randomFeatures(count, seed, kSize);
}

Eigen::Matrix3d turnAndShift() {
  Eigen::Matrix3d h;
  h << 1.02, -0.08, 12.0, 0.07, 0.99, -9.0, 2e-5, -3e-5, 1.0;
  return h;
}

class NearKernels : public ::testing::TestWithParam<const KnnKernel*> {
 protected:
  std::vector<Correspondence> search(const Features& reference, const Features& target,
                                     const Eigen::Matrix3d& prediction, double radius, bool mutual,
                                     int threads = 1) {
    ThreadPool pool(threads);
    NearSearch near(*GetParam(), radius, pool);
    std::vector<Correspondence> found;
    near.match(reference, target, prediction, mutual, found);
    return found;
  }

  void expectExact(const Features& reference, const Features& target,
                   const Eigen::Matrix3d& prediction, double radius) {
    for (const bool mutual : {false, true}) {
      EXPECT_TRUE(same(search(reference, target, prediction, radius, mutual),
                       test::plainNearSearch(reference, target, prediction, radius, mutual)))
          << (mutual ? "mutual, " : "") << "radius " << radius << ", " << reference.size() << " x "
          << target.size();
    }
  }
};

TEST_P(NearKernels, FindTheTwoNearestWithinTheRadius) {
  const Features reference = makeFeatures(700, 1);
  const Features target = makeFeatures(600, 2);
  for (const double radius : {0.5, 5.0, 20.0, 48.0, 133.0, 5000.0}) {
    expectExact(reference, target, turnAndShift(), radius);
    expectExact(reference, target, -3.0 * turnAndShift(), radius);  // the same view
  }
}

TEST_P(NearKernels, FindThemAtAwkwardSizes) {
  for (const int n : {1, 2, 3, 15, 16, 17, 31, 33, 64, 65, 200}) {
    for (const int m : {1, 2, 17, 64, 65}) {
      expectExact(makeFeatures(n, 3), makeFeatures(m, 4), Eigen::Matrix3d::Identity(), 200.0);
    }
  }
}

TEST_P(NearKernels, TakeTheLowerIndexOfEqualDistances) {
  // Few different descriptors, many positions: ties between cells in another order than the
  // indices.
  Features reference = makeFeatures(600, 5);
  Features target = makeFeatures(500, 6);
  for (int i = 0; i < 600; ++i)
    reference.descriptors.row(i % 5).copyTo(reference.descriptors.row(i));
  for (int i = 0; i < 500; ++i) reference.descriptors.row(i % 5).copyTo(target.descriptors.row(i));
  expectExact(reference, target, turnAndShift(), 60.0);
}

TEST_P(NearKernels, CountEveryBit) {
  // All distances from 0 to 256.
  Features reference = makeFeatures(257, 7);
  Features target = makeFeatures(2, 8);
  for (int i = 0; i <= 256; ++i) {
    for (int b = 0; b < 256; ++b) {
      auto& byte = reference.descriptors.at<std::uint8_t>(i, b / 8);
      if (b % 8 == 0) byte = 0;
      if (b < i) byte = static_cast<std::uint8_t>(byte | 1U << (b % 8));
    }
  }
  target.descriptors.row(0).setTo(0);
  target.descriptors.row(1).setTo(255);
  expectExact(reference, target, Eigen::Matrix3d::Identity(), 1000.0);
  const Features farthest = [&] {
    Features one = reference;
    one.keypoints.assign(1, reference.keypoints.back());
    one.descriptors = reference.descriptors.rowRange(256, 257);
    return one;
  }();
  expectExact(farthest, target, Eigen::Matrix3d::Identity(), 1000.0);
}

TEST_P(NearKernels, TakeKeypointsWhereverTheyAre) {
  const float nan = std::nanf("");
  const float infinity = std::numeric_limits<float>::infinity();
  Features reference = makeFeatures(300, 9);
  Features target = makeFeatures(300, 10);
  const cv::Point2f places[] = {{0, 0},     {640, 480},     {-30, 240},      {700, -50},
                                {nan, 3},   {3, infinity},  {1e9F, 1e9F},    {1e8F, 100},
                                {-1e9F, 5}, {639.99F, 480}, {-infinity, nan}};
  for (Features* features : {&reference, &target}) {
    for (std::size_t i = 0; i < 11; ++i) features->keypoints[20 * i].pt = places[i];
  }
  expectExact(reference, target, Eigen::Matrix3d::Identity(), 48.0);
  expectExact(reference, target, turnAndShift(), 30.0);
  // A horizon through the target: keypoints behind it have no predicted position.
  Eigen::Matrix3d oblique = Eigen::Matrix3d::Identity();
  oblique(2, 0) = -1.0 / 400.0;
  const Eigen::Matrix3d seen = oblique.inverse();
  expectExact(reference, target, seen, 48.0);
}

TEST_P(NearKernels, GiveTheSameForAnyNumberOfThreads) {
  const Features reference = makeFeatures(3000, 11);
  const Features target = makeFeatures(2900, 12);
  for (const bool mutual : {false, true}) {
    const auto one = search(reference, target, turnAndShift(), 40.0, mutual, 1);
    for (const int threads : {2, 3, 8}) {
      EXPECT_TRUE(same(search(reference, target, turnAndShift(), 40.0, mutual, threads), one));
    }
  }
}

INSTANTIATE_TEST_SUITE_P(EveryInstructionSet, NearKernels,
                         ::testing::ValuesIn(test::everyKernels(bestKnnKernel,
                                                                portableKnnKernel())),
                         [](const auto& tested) { return std::string(tested.param->name); });

KnnOptions withRadius(double radius, int threads = 1) {
  KnnOptions options;
  options.search_radius = radius;
  options.threads = threads;
  return options;
}

TEST(NearMatching, IsTheWholeSearchWithinALargeRadius) {
  const Features reference = makeFeatures(700, 13);
  const Features target = makeFeatures(800, 14);
  KnnMatcher matcher(withRadius(5000.0));
  std::vector<Correspondence> near;
  std::vector<Correspondence> whole;
  matcher.matchNear(reference, target, Eigen::Matrix3d::Identity(), false, near);
  matcher.match(reference.descriptors, target.descriptors, whole);
  EXPECT_TRUE(same(near, whole));
  matcher.matchNear(reference, target, Eigen::Matrix3d::Identity(), true, near);
  matcher.matchMutual(reference.descriptors, target.descriptors, whole);
  EXPECT_TRUE(same(near, whole));
}

// The index is reused when its content is the same: after changes, also in the same memory, the
// result equals that of a new matcher.
TEST(NearMatching, TakesNoReferenceForAnother) {
  Features reference = makeFeatures(400, 15);
  const Features other =
      makeFeatures(400, 16);  // the same number of features, so that only the content differs
  const Features target = makeFeatures(300, 17);
  KnnMatcher matcher(withRadius(50.0));
  const Eigen::Matrix3d here = Eigen::Matrix3d::Identity();
  const auto expectRight = [&](const std::string& what) {
    SCOPED_TRACE(what);
    for (bool again : {false, true}) {
      std::vector<Correspondence> found;
      std::vector<Correspondence> expected;
      matcher.matchNear(reference, target, here, true, found);
      KnnMatcher(withRadius(50.0)).matchNear(reference, target, here, true, expected);
      EXPECT_TRUE(same(found, expected)) << "near, again: " << again;
      matcher.match(reference.descriptors, target.descriptors, found);
      KnnMatcher().match(reference.descriptors, target.descriptors, expected);
      EXPECT_TRUE(same(found, expected)) << "whole, again: " << again;
    }
  };
  expectRight("the first");
  target.descriptors.row(7).copyTo(reference.descriptors.row(399));
  expectRight("one descriptor");
  for (cv::KeyPoint& keypoint : reference.keypoints) keypoint.pt.x += 40.F;
  expectRight("all places");
  std::swap(reference.keypoints[3].pt, reference.keypoints[300].pt);
  expectRight("two places");
  reference.keypoints.pop_back();
  reference.descriptors.resize(399);
  expectRight("one less");
  reference = other;
  expectRight("another");
  reference = {};
  reference.descriptors.create(0, kDescriptorBytes, CV_8U);
  expectRight("none");
  reference = other;
  expectRight("the one before");
}

TEST(NearMatching, GivesALoneCandidateTheBenefitOfAnUnrelatedSecond) {
  Features reference = makeFeatures(2, 18);
  Features target = makeFeatures(2, 19);
  reference.keypoints[0].pt = target.keypoints[0].pt = {100.F, 100.F};
  reference.keypoints[1].pt = {300.F, 300.F};
  target.keypoints[1].pt = {500.F, 100.F};
  KnnMatcher matcher(withRadius(20.0));
  std::vector<Correspondence> found;
  reference.descriptors.row(0).copyTo(target.descriptors.row(0));
  matcher.matchNear(reference, target, Eigen::Matrix3d::Identity(), true, found);
  ASSERT_EQ(found.size(), 2u);
  EXPECT_EQ(found[0].distance, 0);
  EXPECT_EQ(found[0].second_distance, kUnrelatedDistance);
  EXPECT_TRUE(found[0].mutual);
  EXPECT_EQ(found[1].reference_index, -1);
  EXPECT_EQ(found[1].ratio(), 1.0);  // which every threshold refuses
  EXPECT_FALSE(found[1].mutual);
}

TEST(NearMatching, AllocatesNothingInSteadyState) {
  KnnMatcher matcher(withRadius(48.0, 2));
  const Features frames[] = {makeFeatures(2000, 20), makeFeatures(1900, 21)};
  std::vector<Correspondence> found;
  const auto match = [&](int i, bool mutual) {
    matcher.matchNear(frames[i % 2], frames[(i + 1) % 2], turnAndShift(), mutual, found);
  };
  for (int i = 0; i < 4; ++i) match(i, i >= 2);
  const test::AllocationCounter allocations;
  for (int i = 0; i < 8; ++i) match(i, i % 4 >= 2);
  EXPECT_EQ(allocations.count(), 0u);
}

TEST(NearMatching, RefusesWhatItCannotUse) {
  EXPECT_THROW(KnnMatcher{withRadius(-1.0)}, std::invalid_argument);
  EXPECT_THROW(KnnMatcher{withRadius(std::nan(""))}, std::invalid_argument);
  const Features features = makeFeatures(10, 22);
  std::vector<Correspondence> found;
  const Eigen::Matrix3d here = Eigen::Matrix3d::Identity();
  EXPECT_THROW(KnnMatcher().matchNear(features, features, here, false, found),
               std::invalid_argument);
  KnnMatcher matcher(withRadius(48.0));
  for (const double bad : {0.0, std::nan("")}) {
    EXPECT_THROW(matcher.matchNear(features, features, bad * here, false, found),
                 std::invalid_argument);
  }
  Features broken = features;
  broken.keypoints.pop_back();
  EXPECT_THROW(matcher.matchNear(broken, features, here, false, found), std::invalid_argument);
  Features none;
  matcher.matchNear(none, features, here, false, found);
  EXPECT_TRUE(found.empty());
  matcher.matchNear(features, none, here, true, found);
  EXPECT_TRUE(found.empty());
}

}  // namespace
}  // namespace ktgp_orb::knn
