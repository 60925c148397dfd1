#include "ktgp_orb/knn_matcher.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <opencv2/core.hpp>
#include <random>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "allocation_counter.h"
#include "instruction_sets.h"
#include "ktgp_orb/ratio_filter.h"
#include "matching/knn/kernel.h"
#include "matching/knn/near_search.h"
#include "matching/knn/search.h"
#include "plain_search.h"

namespace ktgp_orb::knn {
namespace {

using test::plainSearch;
using test::same;

class Generator {
 public:
  explicit Generator(unsigned seed) : random_(seed) {}

  cv::Mat descriptors(int rows) {
    return descriptors(rows, [this](int, int) { return static_cast<std::uint8_t>(random_()); });
  }

  /// Copies of `different` random descriptors in random order.
  cv::Mat duplicates(int rows, int different) {
    const cv::Mat originals = descriptors(different);
    cv::Mat all(rows, kDescriptorBytes, CV_8U);
    for (int r = 0; r < rows; ++r) {
      originals.row(static_cast<int>(random_() % static_cast<unsigned>(different)))
          .copyTo(all.row(r));
    }
    return all;
  }

  static cv::Mat descriptors(int rows, const std::function<std::uint8_t(int, int)>& byte) {
    cv::Mat all(rows, kDescriptorBytes, CV_8U);
    for (int r = 0; r < rows; ++r) {
      for (int b = 0; b < kDescriptorBytes; ++b) all.at<std::uint8_t>(r, b) = byte(r, b);
    }
    return all;
  }

 private:
  std::mt19937 random_;
};

class KnnKernels : public ::testing::TestWithParam<const KnnKernel*> {
 protected:
  std::vector<Correspondence> match(const cv::Mat& reference, const cv::Mat& target) {
    search_.match(reference, target, false, result_);
    return result_;
  }

  std::vector<Correspondence> matchMutual(const cv::Mat& reference, const cv::Mat& target) {
    search_.match(reference, target, true, result_);
    return result_;
  }

  /// References around the size of a block, where candidate numbers restart.
  std::vector<int> blockSizes() const {
    const int block = 2 * GetParam()->lanes * kGroupsPerBlock;
    return {block - 1, block, block + 1, 2 * block + 1};
  }

  Generator generator_{20};

 private:
  KnnSearch search_{*GetParam(), 1};  // reused by all calls of a test, as in a sequence
  std::vector<Correspondence> result_;
};

std::vector<const KnnKernel*> everyKernel() {
  return test::everyKernels(bestKnnKernel, portableKnnKernel());
}

INSTANTIATE_TEST_SUITE_P(EveryInstructionSet, KnnKernels, ::testing::ValuesIn(everyKernel()),
                         [](const auto& tested) { return std::string(tested.param->name); });

/// Both searches, against the definitions.
TEST_P(KnnKernels, EqualTheDefinition) {
  const auto expectRight = [&](const cv::Mat& reference, const cv::Mat& target,
                               const std::string& what) {
    const std::string where =
        what + ": " + std::to_string(reference.rows) + " x " + std::to_string(target.rows);
    ASSERT_TRUE(same(match(reference, target), plainSearch(reference, target, false))) << where;
    ASSERT_TRUE(same(matchMutual(reference, target), plainSearch(reference, target, true)))
        << where << ", mutual";
  };
  const auto all = [](int rows, std::uint8_t value) {
    return Generator::descriptors(rows, [value](int, int) { return value; });
  };
  for (int m : {0, 1, 2, 3, 7, 8, 9, 63, 64, 65}) {
    for (int n : {0, 1, 2, 3, 7, 8, 9, 63, 64, 65}) {
      expectRight(generator_.descriptors(m), generator_.descriptors(n), "awkward sizes");
    }
  }
  // Few different descriptors on one side, all different on the other; then ties on both.
  const cv::Mat varied = generator_.descriptors(200);
  cv::Mat repeated = generator_.duplicates(200, 40);
  varied.rowRange(60, 130).copyTo(repeated.rowRange(100, 170));
  for (int n = 0; n <= 200; ++n) {
    const cv::Mat few = varied.rowRange(0, n);
    for (const cv::Mat& other : {repeated.rowRange(0, n), repeated.rowRange(70, 135)}) {
      expectRight(few, other, "every size");
      expectRight(other, few, "every size");
    }
    expectRight(repeated.rowRange(200 - n, 200), repeated.rowRange(60, 130), "ties");
  }
  for (int m : blockSizes()) {
    expectRight(generator_.descriptors(m), generator_.descriptors(9), "across blocks");
    const cv::Mat reference = generator_.duplicates(m, m / 2);
    cv::Mat target = generator_.descriptors(131);
    reference.rowRange(m - 60, m).copyTo(target.rowRange(60, 120));
    expectRight(reference, target, "across blocks and chunks");
  }
  const int many = blockSizes().back();
  for (int m : {1, 2, 63, 64, 65, 130, many}) {
    for (std::uint8_t value : {0x00, 0x5a, 0xff}) {
      expectRight(all(m, 0xff), all(5, value), "all equal");
      expectRight(all(5, 0xff), all(m, value), "all equal");
    }
  }
  for (int different : {2, 3, 10, 100}) {
    for (int m : {65, 300, many}) {
      const cv::Mat reference = generator_.duplicates(m, different);
      cv::Mat target = generator_.duplicates(20, 7);
      reference.rowRange(0, 10).copyTo(target.rowRange(0, 10));
      expectRight(reference, target, "duplicates");
    }
  }
  const cv::Mat target = generator_.descriptors(3);
  const cv::Mat random = generator_.descriptors(many);
  for (int first : {0, 1, many / 2 - 1}) {
    for (int step : {1, 9, many / 2}) {
      cv::Mat reference = random.clone();
      target.row(1).copyTo(reference.row(first));
      target.row(1).copyTo(reference.row(first + step));
      expectRight(reference, target, "two equal, " + std::to_string(step) + " apart");
    }
  }
  // Candidate r differs from the target in the last 256 - r bits, or in the first r: every
  // candidate is a new best, or none is.
  const auto leadingOnes = [](int ones, int b) {
    return static_cast<std::uint8_t>(0xff00 >> std::clamp(ones - 8 * b, 0, 8));
  };
  const cv::Mat closer =
      Generator::descriptors(257, [&](int r, int b) { return leadingOnes(256 - r, b); });
  const cv::Mat farther = Generator::descriptors(257, leadingOnes);
  for (int n = 1; n <= 257; ++n) {
    expectRight(closer.rowRange(0, n), all(1, 0), "ever closer");
    expectRight(farther.rowRange(0, n), all(1, 0), "ever farther");
  }
  const cv::Mat wide_reference = generator_.descriptors(6 * 70).reshape(0, 70);
  const cv::Mat wide_target = generator_.descriptors(6 * 30).reshape(0, 30);
  for (int column : {0, 1, 33, 160}) {
    expectRight(wide_reference.colRange(column, column + 32),
                wide_target.colRange(column, column + 32), "gaps between rows");
  }
}

TEST_P(KnnKernels, FindTheNearestTwoWhereverTheyAre) {
  const int m = blockSizes().back();
  const cv::Mat target = Generator::descriptors(1, [](int, int) { return std::uint8_t{0}; });
  cv::Mat reference = Generator::descriptors(m, [](int, int) { return std::uint8_t{0xff}; });
  for (int nearest = 0; nearest < m; nearest += 1 + nearest / 100) {
    for (int step : {1, 7, 64, m / 2}) {
      const int second = (nearest + step) % m;
      auto& one_byte = reference.at<std::uint8_t>(nearest, nearest % kDescriptorBytes);
      auto& other_byte = reference.at<std::uint8_t>(second, nearest % 31);
      one_byte = 0x3f;    // distance 254
      other_byte = 0xef;  // 255, all others 256
      const std::vector<Correspondence> expected{{nearest, 0, 254, 255, Level::knn}};
      ASSERT_TRUE(same(match(reference, target), expected)) << nearest << " and " << second;
      one_byte = other_byte = 0xff;
    }
  }
}

TEST_P(KnnKernels, GiveTheSameForAnyNumberOfThreads) {
  const cv::Mat reference = generator_.duplicates(1500, 1000);
  cv::Mat target = generator_.duplicates(777, 500);
  reference.rowRange(300, 700).copyTo(target.rowRange(200, 600));
  const std::vector<Correspondence> expected = plainSearch(reference, target, false);
  const std::vector<Correspondence> mutual = plainSearch(reference, target, true);
  for (int threads : {0, 1, 2, 3, 8}) {
    KnnSearch search(*GetParam(), threads);
    std::vector<Correspondence> result;
    for (int repetition = 0; repetition < 5; ++repetition) {
      search.match(reference, target, true, result);
      ASSERT_TRUE(same(result, mutual)) << threads << " threads";
      search.match(reference, target, false, result);
      ASSERT_TRUE(same(result, expected)) << threads << " threads";
    }
  }
}

TEST_P(KnnKernels, AllocateNothingInSteadyState) {
  const cv::Mat reference = generator_.descriptors(1000);
  const cv::Mat target = generator_.descriptors(1000);
  for (int threads : {1, 3}) {
    KnnSearch search(*GetParam(), threads);
    std::vector<Correspondence> result;
    search.match(reference, target, true, result);
    const test::AllocationCounter allocations;
    for (int n : {1000, 3, 0, 999}) {
      search.match(reference.rowRange(0, n), target, false, result);
      search.match(reference, target.rowRange(0, n), false, result);
      search.match(reference.rowRange(0, n), target, true, result);
      search.match(reference, target.rowRange(0, n), true, result);
    }
    EXPECT_EQ(allocations.count(), 0u) << threads << " threads";
  }
}

TEST(KnnKernel, DefaultsToTheFastest) {
  EXPECT_EQ(&bestKnnKernel(), everyKernel().front());
}

/// Answer for target t alone.
Correspondence nearestTwo(const cv::Mat& reference, const cv::Mat& target, int t) {
  Correspondence c = plainSearch(reference, target.row(t), false).front();
  c.target_index = t;
  return c;
}

TEST(KnnMatcher, TakesAHundredThousandFeaturesOnEitherSide) {
  Generator generator(3);
  const cv::Mat many = generator.duplicates(100000, 60000);
  const cv::Mat few = generator.descriptors(500);
  KnnMatcher matcher;
  std::vector<Correspondence> result;
  std::vector<Correspondence> other;
  const test::AllocationCounter allocations;
  matcher.match(many, few, other);
  matcher.match(few, many, result);
  // 66 bytes per reference, one correspondence per target; a matrix of distances would take 50 MB.
  EXPECT_LT(allocations.bytes(), 100000 * (68 + sizeof(Correspondence)) + 100000);
  ASSERT_EQ(other.size(), 500u);
  ASSERT_EQ(result.size(), 100000u);
  for (int t = 0; t < 500; t += 50) {
    ASSERT_TRUE(same({other[static_cast<std::size_t>(t)]}, {nearestTwo(many, few, t)}));
  }
  for (int t = 0; t < 100000; t += 777) {
    ASSERT_TRUE(same({result[static_cast<std::size_t>(t)]}, {nearestTwo(few, many, t)}));
  }
}

TEST(KnnMatcher, GoesOnWorkingAfterAMove) {
  Generator generator(5);
  const cv::Mat reference = generator.descriptors(50);
  const cv::Mat target = generator.descriptors(40);
  KnnMatcher first;
  KnnMatcher second = std::move(first);
  std::vector<Correspondence> result;
  second.match(reference, target, result);
  EXPECT_TRUE(same(result, plainSearch(reference, target, false)));
}

TEST(KnnMatcher, GivesNothingWithoutReferenceOrTarget) {
  Generator generator(6);
  const cv::Mat some = generator.descriptors(3);
  KnnMatcher matcher;
  std::vector<Correspondence> result(7);
  matcher.match(cv::Mat(), some, result);
  EXPECT_TRUE(result.empty());
  result.resize(7);
  matcher.match(some, cv::Mat(), result);
  EXPECT_TRUE(result.empty());
  matcher.match(some, cv::Mat(5, 0, CV_8U), result);  // has rows, and no bytes to read
  EXPECT_TRUE(result.empty());
}

TEST(KnnMatcher, RefusesDescriptorsOfAnotherTypeOrWidth) {
  const cv::Mat good(4, 32, CV_8U, cv::Scalar(0));
  KnnMatcher matcher;
  std::vector<Correspondence> result;
  for (const cv::Mat& bad :
       {cv::Mat(4, 31, CV_8U), cv::Mat(4, 33, CV_8U), cv::Mat(4, 64, CV_8U), cv::Mat(4, 32, CV_32F),
        cv::Mat(4, 32, CV_8S), cv::Mat(4, 32, CV_8UC2), cv::Mat(32, 4, CV_8U)}) {
    EXPECT_THROW(matcher.match(bad, good, result), std::invalid_argument);
    EXPECT_THROW(matcher.match(good, bad, result), std::invalid_argument);
  }
}

// The search near predicted positions.

Features makeFeatures(int count, std::uint32_t seed) {
  return test::randomFeatures(count, seed, {640, 480});
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
    util::ThreadPool pool(threads);
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
  Features farthest = reference;
  farthest.keypoints.assign(1, reference.keypoints.back());
  farthest.descriptors = reference.descriptors.rowRange(256, 257);
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
  expectExact(reference, target, oblique.inverse(), 48.0);
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

TEST(NearMatching, LargeRadiusEqualsWholeSearch) {
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

TEST(NearMatching, RefusesUnusableInput) {
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

namespace ktgp_orb {
namespace {

// The ratio filter.

Correspondence pair(int d1, int d2, Level level = Level::knn) {
  return {0, 0, d1, d2, level};
}

TEST(RatioFilter, IsStrictWhereTheRatioEqualsTheThreshold) {
  // 33/50 is 0.66 to the last bit, but 0.66 * 50 > 33 in floating point.
  std::vector<Correspondence> c{pair(33, 50), pair(32, 50), pair(34, 50)};
  EXPECT_EQ(filterByRatio(0.66, c), 1u);
  EXPECT_EQ(c[0].level, Level::knn);
  EXPECT_EQ(c[1].level, Level::kt);
  EXPECT_EQ(c[2].level, Level::knn);
}

TEST(RatioFilter, DropsIdenticalCandidatesAtEveryThreshold) {
  std::vector<Correspondence> c{pair(0, 0)};
  EXPECT_EQ(filterByRatio(1.0, c), 0u);
}

TEST(RatioFilter, KeepsAnExactMatchWithADistinctSecond) {
  std::vector<Correspondence> c{pair(0, 1)};
  EXPECT_EQ(filterByRatio(0.01, c), 1u);
}

TEST(RatioFilter, AgreesWithRationalArithmeticForEveryPairOfDistances) {
  std::vector<Correspondence> c;
  for (int hundredths = 1; hundredths <= 100; ++hundredths) {
    c.clear();
    for (int d2 = 0; d2 <= 256; ++d2) {
      for (int d1 = 0; d1 <= d2; ++d1) c.push_back(pair(d1, d2));
    }
    filterByRatio(hundredths / 100.0, c);
    for (const Correspondence& x : c) {
      const bool expected = 100 * x.distance < hundredths * x.second_distance;
      ASSERT_EQ(x.level == Level::kt, expected)
          << x.distance << '/' << x.second_distance << " at " << hundredths << '%';
    }
  }
}

TEST(RatioFilter, CountsWhatItKeepsForEverySize) {
  for (int n = 0; n <= 200; ++n) {
    std::vector<Correspondence> c;
    std::size_t expected = 0;
    for (int i = 0; i < n; ++i) {
      c.push_back(pair(i % 17, 10));
      if (i % 17 < 5) ++expected;
    }
    EXPECT_EQ(filterByRatio(0.5, c), expected);
    EXPECT_EQ(countAtLeast(c, Level::kt), expected);
  }
}

TEST(RatioFilter, KeepsOnlyMutualPairsWhereAskedTo) {
  const auto pairs = [] {
    std::vector<Correspondence> c{pair(3, 10), pair(3, 10), pair(9, 10), pair(9, 10)};
    c[0].mutual = c[2].mutual = true;
    return c;
  };
  std::vector<Correspondence> c = pairs();
  EXPECT_EQ(filterByRatio(0.5, c, true), 1u);
  EXPECT_EQ(c[0].level, Level::kt);
  c = pairs();
  EXPECT_EQ(filterByRatio(1.0, c, true), 2u);
  EXPECT_EQ(c[2].level, Level::kt);
  c = pairs();
  EXPECT_EQ(filterByRatio(0.5, c, false), 2u);
}

TEST(RatioFilter, DropsEquallyNearCandidatesAtEveryThresholdMutualOrNot) {
  std::vector<Correspondence> c{pair(10, 10), pair(0, 0), pair(9, 10)};
  for (Correspondence& x : c) x.mutual = true;
  EXPECT_EQ(filterByRatio(1.0, c, true), 1u);
  EXPECT_EQ(c[2].level, Level::kt);
}

TEST(RatioFilter, RefusesAThresholdOutsideItsRange) {
  std::vector<Correspondence> c;
  for (double bad : {0.0, -0.1, 1.01, std::numeric_limits<double>::quiet_NaN()}) {
    EXPECT_THROW(filterByRatio(bad, c), std::invalid_argument);
  }
}

}  // namespace
}  // namespace ktgp_orb
