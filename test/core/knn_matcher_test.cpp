#include "ktgp_orb/knn_matcher.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <bitset>
#include <cstring>
#include <functional>
#include <opencv2/features2d.hpp>
#include <opencv2/imgcodecs.hpp>
#include <random>
#include <stdexcept>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "allocation_counter.h"
#include "core/knn/kernel.h"
#include "core/knn/search.h"
#include "instruction_sets.h"
#include "test_data.h"

namespace ktgp_orb::knn {
namespace {

int hamming(const std::uint8_t* a, const std::uint8_t* b) {
  int distance = 0;
  for (int i = 0; i < kDescriptorBytes; i += 8) {
    std::uint64_t bits[2];
    std::memcpy(&bits[0], a + i, 8);
    std::memcpy(&bits[1], b + i, 8);
    distance += static_cast<int>(std::bitset<64>(bits[0] ^ bits[1]).count());
  }
  return distance;
}

/// The definition, pair by pair.
Correspondence nearestTwo(const cv::Mat& reference, const cv::Mat& target, int t) {
  Correspondence c{-1, t, 1000, 1000, Level::knn};
  for (int r = 0; r < reference.rows; ++r) {
    const int distance = hamming(reference.ptr(r), target.ptr(t));
    if (distance < c.distance) {
      c.second_distance = c.distance;
      c.distance = distance;
      c.reference_index = r;
    } else {
      c.second_distance = std::min(c.second_distance, distance);
    }
  }
  if (reference.rows == 1) c.second_distance = 0;
  return c;
}

std::vector<Correspondence> naive(const cv::Mat& reference, const cv::Mat& target) {
  std::vector<Correspondence> all;
  for (int t = 0; t < target.rows && !reference.empty(); ++t) {
    all.push_back(nearestTwo(reference, target, t));
  }
  return all;
}

/// The definition of mutual: the pairs that two searches agree on.
std::vector<Correspondence> naiveMutual(const cv::Mat& reference, const cv::Mat& target) {
  std::vector<Correspondence> forth = naive(reference, target);
  const std::vector<Correspondence> back = naive(target, reference);
  for (Correspondence& c : forth) {
    c.mutual = back[static_cast<std::size_t>(c.reference_index)].reference_index == c.target_index;
  }
  return forth;
}

std::string toString(const Correspondence& c) {
  return std::to_string(c.target_index) + " -> " + std::to_string(c.reference_index) + " at " +
         std::to_string(c.distance) + ", second " + std::to_string(c.second_distance) + ", level " +
         std::to_string(static_cast<int>(c.level)) + (c.mutual ? ", mutual" : "");
}

::testing::AssertionResult same(const std::vector<Correspondence>& actual,
                                const std::vector<Correspondence>& expected) {
  if (actual.size() != expected.size()) {
    return ::testing::AssertionFailure()
           << actual.size() << " correspondences instead of " << expected.size();
  }
  for (std::size_t i = 0; i < actual.size(); ++i) {
    const auto fields = [](const Correspondence& c) {
      return std::tie(c.target_index, c.reference_index, c.distance, c.second_distance, c.level,
                      c.mutual);
    };
    if (fields(actual[i]) == fields(expected[i])) continue;
    return ::testing::AssertionFailure()
           << toString(actual[i]) << " instead of " << toString(expected[i]);
  }
  return ::testing::AssertionSuccess();
}

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
    search_.match(reference, target, result_);
    return result_;
  }

  std::vector<Correspondence> matchMutual(const cv::Mat& reference, const cv::Mat& target) {
    search_.matchMutual(reference, target, result_);
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

TEST_P(KnnKernels, FindTheNearestTwoAtAwkwardSizes) {
  const int sizes[] = {0, 1, 2, 3, 7, 8, 9, 63, 64, 65};
  for (int m : sizes) {
    for (int n : sizes) {
      const cv::Mat reference = generator_.descriptors(m);
      const cv::Mat target = generator_.descriptors(n);
      ASSERT_TRUE(same(match(reference, target), naive(reference, target))) << m << " x " << n;
    }
  }
}

TEST_P(KnnKernels, FindTheNearestTwoAtEverySize) {
  const cv::Mat reference = generator_.descriptors(200);
  const cv::Mat target = generator_.descriptors(200);
  for (int n = 0; n <= 200; ++n) {
    const cv::Mat few_references = reference.rowRange(0, n);
    const cv::Mat five_targets = target.rowRange(0, std::min(n, 5));
    ASSERT_TRUE(same(match(few_references, five_targets), naive(few_references, five_targets)))
        << n;
    const cv::Mat five_references = reference.rowRange(0, 5);
    const cv::Mat few_targets = target.rowRange(0, n);
    ASSERT_TRUE(same(match(five_references, few_targets), naive(five_references, few_targets)))
        << n;
  }
}

TEST_P(KnnKernels, FindTheNearestTwoAcrossBlocks) {
  const cv::Mat target = generator_.descriptors(9);
  for (int m : blockSizes()) {
    const cv::Mat reference = generator_.descriptors(m);
    ASSERT_TRUE(same(match(reference, target), naive(reference, target))) << m;
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

TEST_P(KnnKernels, TakeTheLowestIndexWhereAllAreEqual) {
  for (int m : {1, 2, 63, 64, 65, blockSizes().back()}) {
    for (std::uint8_t value : {0x00, 0x5a, 0xff}) {
      const cv::Mat reference = Generator::descriptors(m, [](int, int) { return 0xff; });
      const cv::Mat target = Generator::descriptors(5, [value](int, int) { return value; });
      ASSERT_TRUE(same(match(reference, target), naive(reference, target)))
          << m << " at " << int{value};
    }
  }
}

TEST_P(KnnKernels, TakeTheLowestIndexAmongDuplicates) {
  for (int different : {2, 3, 10, 100}) {
    for (int m : {65, 300, blockSizes().back()}) {
      const cv::Mat reference = generator_.duplicates(m, different);
      cv::Mat target = generator_.duplicates(20, 7);
      reference.rowRange(0, 10).copyTo(target.rowRange(0, 10));
      ASSERT_TRUE(same(match(reference, target), naive(reference, target)))
          << different << " in " << m;
    }
  }
}

TEST_P(KnnKernels, TakeTheLowestIndexAcrossBlocks) {
  const int m = blockSizes().back();
  const cv::Mat target = generator_.descriptors(3);
  const cv::Mat random = generator_.descriptors(m);
  for (int first : {0, 1, m / 2 - 1}) {
    for (int step : {1, 9, m / 2}) {
      cv::Mat reference = random.clone();
      target.row(1).copyTo(reference.row(first));
      target.row(1).copyTo(reference.row(first + step));
      ASSERT_TRUE(same(match(reference, target), naive(reference, target)))
          << first << " and " << first + step;
    }
  }
}

TEST_P(KnnKernels, FollowCandidatesThatComeEverCloser) {
  // Candidate r differs from the target in the last 256 - r bits, or in the first r: every
  // candidate is a new best, or none is.
  const cv::Mat target = Generator::descriptors(1, [](int, int) { return std::uint8_t{0}; });
  const auto leadingOnes = [](int ones, int b) {
    return static_cast<std::uint8_t>(0xff00 >> std::clamp(ones - 8 * b, 0, 8));
  };
  const cv::Mat closer =
      Generator::descriptors(257, [&](int r, int b) { return leadingOnes(256 - r, b); });
  const cv::Mat farther = Generator::descriptors(257, leadingOnes);
  for (int n = 1; n <= 257; ++n) {
    ASSERT_TRUE(same(match(closer.rowRange(0, n), target), naive(closer.rowRange(0, n), target)));
    ASSERT_TRUE(same(match(farther.rowRange(0, n), target), naive(farther.rowRange(0, n), target)));
  }
}

TEST_P(KnnKernels, ReadMatricesWithGapsBetweenRows) {
  const cv::Mat wide_reference = generator_.descriptors(6 * 70).reshape(0, 70);
  const cv::Mat wide_target = generator_.descriptors(6 * 30).reshape(0, 30);
  for (int column : {0, 1, 33, 160}) {
    const cv::Mat reference = wide_reference.colRange(column, column + 32);
    const cv::Mat target = wide_target.colRange(column, column + 32);
    ASSERT_FALSE(reference.isContinuous());
    ASSERT_TRUE(same(match(reference, target), naive(reference, target))) << column;
  }
}

TEST_P(KnnKernels, FindMutualPairsAtEverySize) {
  // Few different descriptors on one side, all different on the other; then ties on both.
  const cv::Mat varied = generator_.descriptors(200);
  cv::Mat repeated = generator_.duplicates(200, 40);
  varied.rowRange(60, 130).copyTo(repeated.rowRange(100, 170));
  for (int n = 0; n <= 200; ++n) {
    const cv::Mat few = varied.rowRange(0, n);
    for (const cv::Mat& other : {repeated.rowRange(0, n), repeated.rowRange(70, 135)}) {
      ASSERT_TRUE(same(matchMutual(few, other), naiveMutual(few, other))) << n;
      ASSERT_TRUE(same(matchMutual(other, few), naiveMutual(other, few))) << n;
    }
    const cv::Mat tied = repeated.rowRange(200 - n, 200);
    const cv::Mat ties = repeated.rowRange(60, 130);
    ASSERT_TRUE(same(matchMutual(tied, ties), naiveMutual(tied, ties))) << n;
  }
}

TEST_P(KnnKernels, FindMutualPairsAcrossBlocksAndChunks) {
  for (int m : blockSizes()) {
    const cv::Mat reference = generator_.duplicates(m, m / 2);
    cv::Mat target = generator_.descriptors(131);
    reference.rowRange(m - 60, m).copyTo(target.rowRange(60, 120));
    ASSERT_TRUE(same(matchMutual(reference, target), naiveMutual(reference, target))) << m;
  }
}

TEST_P(KnnKernels, TakeTheLowestTargetWhereAllAreEqual) {
  for (int m : {1, 2, 63, 64, 65, 130}) {
    for (std::uint8_t value : {0x00, 0x5a, 0xff}) {
      const cv::Mat reference = Generator::descriptors(m, [](int, int) { return 0xff; });
      const cv::Mat target = Generator::descriptors(200, [value](int, int) { return value; });
      const std::vector<Correspondence> pairs = matchMutual(reference, target);
      ASSERT_TRUE(same(pairs, naiveMutual(reference, target))) << m << " at " << int{value};
      ASSERT_TRUE(pairs.front().mutual);
    }
  }
}

TEST_P(KnnKernels, FindTheSameMutualPairsForAnyNumberOfThreads) {
  const cv::Mat reference = generator_.duplicates(1500, 1000);
  cv::Mat target = generator_.duplicates(777, 500);
  reference.rowRange(300, 700).copyTo(target.rowRange(200, 600));
  const std::vector<Correspondence> expected = naiveMutual(reference, target);
  for (int threads : {1, 2, 3, 8}) {
    KnnSearch search(*GetParam(), threads);
    std::vector<Correspondence> result;
    for (int repetition = 0; repetition < 5; ++repetition) {
      search.matchMutual(reference, target, result);
      ASSERT_TRUE(same(result, expected)) << threads << " threads";
    }
    search.match(reference, target, result);
    ASSERT_TRUE(same(result, naive(reference, target))) << "marks nothing when not asked to";
  }
}

TEST_P(KnnKernels, GiveTheSameForAnyNumberOfThreads) {
  const cv::Mat reference = generator_.duplicates(3000, 2000);
  const cv::Mat target = generator_.descriptors(777);
  const std::vector<Correspondence> expected = match(reference, target);
  for (int threads : {1, 2, 3, 8}) {
    KnnSearch search(*GetParam(), threads);
    std::vector<Correspondence> result;
    for (int repetition = 0; repetition < 5; ++repetition) {
      search.match(reference, target, result);
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
    search.matchMutual(reference, target, result);
    const test::AllocationCounter allocations;
    for (int n : {1000, 3, 0, 999}) {
      search.match(reference.rowRange(0, n), target, result);
      search.match(reference, target.rowRange(0, n), result);
      search.matchMutual(reference.rowRange(0, n), target, result);
      search.matchMutual(reference, target.rowRange(0, n), result);
    }
    EXPECT_EQ(allocations.count(), 0u) << threads << " threads";
  }
}

TEST_P(KnnKernels, AgreeWithBruteForceMatcherOnRealImages) {
  const auto data = test::dataFolder();
  KTGP_ORB_REQUIRE_FOLDER(data, "KTGP_ORB_DATA");
  const auto orb = cv::ORB::create(2000);
  const auto describe = [&](const std::string& file) {
    cv::Mat image = cv::imread(*data + "/oxford/" + file, cv::IMREAD_GRAYSCALE);
    std::vector<cv::KeyPoint> keypoints;
    cv::Mat descriptors;
    if (!image.empty()) orb->detectAndCompute(image, cv::noArray(), keypoints, descriptors);
    return descriptors;
  };
  for (const std::string set : {"leuven", "bikes"}) {
    const cv::Mat reference = describe(set + "/img1.ppm");
    const cv::Mat target = describe(set + "/img4.ppm");
    ASSERT_GT(reference.rows, 1000) << set;
    std::vector<std::vector<cv::DMatch>> expected;
    cv::BFMatcher(cv::NORM_HAMMING).knnMatch(target, reference, expected, 2);
    const std::vector<Correspondence> actual = match(reference, target);
    ASSERT_EQ(actual.size(), expected.size());
    for (std::size_t i = 0; i < actual.size(); ++i) {
      ASSERT_EQ(actual[i].target_index, static_cast<int>(i));
      ASSERT_EQ(actual[i].distance, expected[i][0].distance) << set << ' ' << i;
      ASSERT_EQ(actual[i].second_distance, expected[i][1].distance) << set << ' ' << i;
    }
    for (int t = 0; t < target.rows; t += 25) {
      const std::vector<Correspondence> one{actual[static_cast<std::size_t>(t)]};
      ASSERT_TRUE(same(one, {nearestTwo(reference, target, t)})) << set;
    }
  }
}

TEST(KnnKernel, IsTheFastestUnlessToldOtherwise) {
  EXPECT_EQ(&bestKnnKernel(), everyKernel().front());
}

TEST(KnnMatcher, TakesAHundredThousandFeaturesOnEitherSide) {
  Generator generator(3);
  const cv::Mat many = generator.duplicates(100000, 60000);
  const cv::Mat few = generator.descriptors(500);
  KnnMatcher matcher;
  std::vector<Correspondence> result;
  const test::AllocationCounter allocations;
  matcher.match(many, few, result);
  ASSERT_EQ(result.size(), 500u);
  for (int t = 0; t < 500; t += 50) {
    ASSERT_TRUE(same({result[static_cast<std::size_t>(t)]}, {nearestTwo(many, few, t)}));
  }
  matcher.match(few, many, result);
  ASSERT_EQ(result.size(), 100000u);
  for (int t = 0; t < 100000; t += 777) {
    ASSERT_TRUE(same({result[static_cast<std::size_t>(t)]}, {nearestTwo(few, many, t)}));
  }
  // 66 bytes per reference, one correspondence per target; a matrix of distances would take 50 MB.
  EXPECT_LT(allocations.bytes(), 100000 * (68 + sizeof(Correspondence)) + 100000);
}

TEST(KnnMatcher, GivesTheSameForAnyNumberOfThreads) {
  Generator generator(4);
  const cv::Mat reference = generator.descriptors(500);
  const cv::Mat target = generator.descriptors(400);
  const std::vector<Correspondence> expected = naive(reference, target);
  for (int threads : {0, 1, 2, 3, 8}) {
    KnnOptions options;
    options.threads = threads;
    std::vector<Correspondence> result;
    KnnMatcher(options).match(reference, target, result);
    EXPECT_TRUE(same(result, expected)) << threads << " threads";
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
  EXPECT_TRUE(same(result, naive(reference, target)));
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
