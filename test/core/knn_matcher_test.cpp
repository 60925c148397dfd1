#include "ktgp_orb/knn_matcher.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <opencv2/core.hpp>
#include <random>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "allocation_counter.h"
#include "core/knn/kernel.h"
#include "core/knn/search.h"
#include "instruction_sets.h"
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
TEST_P(KnnKernels, GiveWhatTheDefinitionGives) {
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

TEST(KnnKernel, IsTheFastestUnlessToldOtherwise) {
  EXPECT_EQ(&bestKnnKernel(), everyKernel().front());
}

/// Of target t alone.
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

TEST(KnnMatcher, RefusesANegativeNumberOfThreads) {
  KnnOptions options;
  options.threads = -1;
  EXPECT_THROW(KnnMatcher{options}, std::invalid_argument);
}

}  // namespace
}  // namespace ktgp_orb::knn
