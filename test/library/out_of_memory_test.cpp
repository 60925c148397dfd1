// Every single allocation of every public call fails once: the call throws, and the next call gives
// the right result.
#include <gtest/gtest.h>

#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <functional>
#include <opencv2/core.hpp>

#include "allocation_counter.h"
#include "ktgp_orb/sequence_matcher.h"
#include "orb_test_images.h"

namespace {

/// Number of allocations that succeed before one fails; below zero: all succeed. For all threads.
std::atomic<long> left{-1};
std::atomic<bool> refused{false};

bool mayAllocate() {
  long count = left;
  while (count >= 0) {
    if (count == 0) {
      refused = true;
      left = -1;  // only this one fails; the cleanup has memory
      return false;
    }
    if (left.compare_exchange_weak(count, count - 1)) break;
  }
  return true;
}

const bool kIsAsked = (ktgp_orb::test::may_allocate = mayAllocate, true);

}  // namespace

/// OpenCV allocates its pixels with this.
extern "C" int posix_memalign(void** memory, std::size_t alignment, std::size_t size) {
  if (!mayAllocate()) return ENOMEM;
  *memory = std::aligned_alloc(alignment, (size + alignment) / alignment * alignment);
  return *memory == nullptr ? ENOMEM : 0;
}

namespace ktgp_orb {
namespace {

cv::Mat picture(int shift) {
  static const cv::Mat scene = test::blockImage({380, 280}, 1, 70);
  return scene(cv::Rect(shift, shift, 320, 240)).clone();
}

/// Runs `call` with the first, second, third ... allocation failing, until no allocation is left to
/// fail. After each failure runs `call` again, and `check` on its result.
void refuseEach(const std::function<std::function<void()>()>& make,
                const std::function<void()>& check) {
  int failures = 0;
  for (long k = 0; k < 5000; ++k) {
    const auto call = make();
    refused = false;
    left = k;
    bool thrown = false;
    try {
      call();
    } catch (const std::bad_alloc&) {
      thrown = true;
    } catch (const cv::Exception& error) {
      left = -1;
      thrown = true;
      EXPECT_EQ(error.code, cv::Error::StsNoMem) << error.what();
    }
    left = -1;
    EXPECT_EQ(thrown, refused.load()) << "allocation " << k;
    if (!thrown) {
      check();
      std::printf("%d allocations refused\n", failures);
      EXPECT_GT(failures, 0);
      return;
    }
    ++failures;
    ASSERT_NO_THROW(call()) << "after allocation " << k << " was refused";
    check();
    if (testing::Test::HasFailure()) return;
  }
  FAIL() << "no end of allocations";
}

/// The same for the call of a stage, which begins anew each time, as does its result.
template <typename Stage, typename Options, typename Result, typename Call>
void refuseEachOf(const Options& options, Result& result, const Call& call,
                  const std::function<void()>& check) {
  refuseEach(
      [&]() -> std::function<void()> {
        const auto stage = std::make_shared<Stage>(options);
        result = {};
        return [&call, stage] { call(*stage); };
      },
      check);
}

class OutOfMemory : public testing::Test {
 protected:
  void SetUp() override {
    ASSERT_TRUE(kIsAsked);
    cv::setNumThreads(1);
    OrbExtractor extractor(orb());
    extractor.extract(picture(0), reference_);
    extractor.extract(picture(5), target_);
    KtgpMatcher(matcher()).match(reference_, target_, result_);
    ASSERT_EQ(result_.status, Status::ok);
    for (const Correspondence& c : result_.correspondences) {
      if (c.level < Level::kt) continue;
      const auto& r = reference_.keypoints[static_cast<std::size_t>(c.reference_index)].pt;
      const auto& t = target_.keypoints[static_cast<std::size_t>(c.target_index)].pt;
      pairs_.add({r.x, r.y}, {t.x, t.y}, c.ratio());
    }
  }

  static OrbOptions orb() {
    OrbOptions options;
    options.max_features = 400;
    return options;
  }
  static MatcherOptions matcher() {
    MatcherOptions options;
    options.guided.enabled = true;
    options.mutual = true;
    return options;
  }

  Features reference_, target_;
  MatchResult result_;
  PointPairs pairs_;
};

TEST_F(OutOfMemory, Extraction) {
  for (const DescriptorKind kind : {DescriptorKind::orb, DescriptorKind::teblid}) {
    OrbOptions options = orb();
    options.descriptor = kind;
    options.distribution = KeypointDistribution::uniform;
    Features expected, features;
    OrbExtractor(options).extract(picture(5), expected);
    refuseEachOf<OrbExtractor>(
        options, features, [&](OrbExtractor& stage) { stage.extract(picture(5), features); },
        [&] {
          ASSERT_EQ(features.size(), expected.size());
          EXPECT_EQ(cv::norm(features.descriptors, expected.descriptors, cv::NORM_INF), 0.0);
        });
  }
}

TEST_F(OutOfMemory, NearestNeighbours) {
  std::vector<Correspondence> found;
  for (const int threads : {1, 2}) {
    refuseEachOf<KnnMatcher>(
        KnnOptions{threads}, found,
        [&](KnnMatcher& stage) {
          stage.matchMutual(reference_.descriptors, target_.descriptors, found);
        },
        [&] {
          ASSERT_EQ(found.size(), target_.size());
          for (std::size_t i = 0; i < found.size(); ++i) {
            EXPECT_EQ(found[i].reference_index, result_.correspondences[i].reference_index);
          }
        });
  }
}

TEST_F(OutOfMemory, MotionStatistics) {
  GmsOptions options;
  options.rotation = options.scale = true;
  const auto input = [this] {
    auto matches = result_.correspondences;
    for (Correspondence& c : matches) c.level = c.level >= Level::kt ? Level::kt : Level::knn;
    return matches;
  };
  auto expected = input();
  GmsFilter(options).filter(reference_, target_, expected);
  std::vector<Correspondence> matches;
  refuseEachOf<GmsFilter>(
      options, matches,
      [&](GmsFilter& stage) {
        matches = input();
        stage.filter(reference_, target_, matches);
      },
      [&] { EXPECT_EQ(countAtLeast(matches, Level::ktg), countAtLeast(expected, Level::ktg)); });
}

TEST_F(OutOfMemory, Prosac) {
  ProsacResult expected, result;
  ProsacHomography().estimate(pairs_, reference_.image_size, expected);
  refuseEachOf<ProsacHomography>(
      ProsacOptions(), result,
      [&](ProsacHomography& stage) { stage.estimate(pairs_, reference_.image_size, result); },
      [&] {
        EXPECT_EQ(result.answer.homography, expected.answer.homography);
        EXPECT_EQ(result.mask, expected.mask);
      });
}

TEST_F(OutOfMemory, GuidedMatchingAndAlignment) {
  std::vector<Correspondence> guided, expected;
  GuidedOptions options;
  options.enabled = true;
  GuidedMatcher(options).match(reference_, target_, result_.answer.homography, expected);
  refuseEachOf<GuidedMatcher>(
      options, guided,
      [&](GuidedMatcher& stage) {
        stage.match(reference_, target_, result_.answer.homography, guided);
      },
      [&] { EXPECT_EQ(guided.size(), expected.size()); });
  AlignmentResult aligned, aligned_expected;
  UncertainHomography start;
  start.homography = result_.answer.homography;
  start.covariance = result_.answer.covariance;
  Alignment().align(reference_, target_, expected, start, aligned_expected);
  refuseEachOf<Alignment>(
      AlignmentOptions(), aligned,
      [&](Alignment& stage) { stage.align(reference_, target_, expected, start, aligned); },
      [&] {
        EXPECT_EQ(aligned.status, aligned_expected.status);
        EXPECT_EQ(aligned.answer.homography, aligned_expected.answer.homography);
      });
}

TEST_F(OutOfMemory, AllStages) {
  MatchResult result;
  refuseEachOf<KtgpMatcher>(
      matcher(), result, [&](KtgpMatcher& stage) { stage.match(reference_, target_, result); },
      [&] {
        EXPECT_EQ(result.answer.homography, result_.answer.homography);
        EXPECT_EQ(result.inliers, result_.inliers);
      });
}

TEST_F(OutOfMemory, ASequenceGoesOn) {
  SequenceOptions options;
  options.orb = orb();
  options.matcher = matcher();
  Status status = Status::no_model;
  int ok = 0;
  refuseEach(
      [&]() -> std::function<void()> {
        const auto sequence = std::make_shared<SequenceMatcher>(options);
        sequence->match(picture(0), 1.0);
        const auto time = std::make_shared<double>(1.0);
        return [&, sequence, time] {
          *time += 0.1;
          status = sequence->match(picture(5), *time).match.status;
        };
      },
      [&] {
        // The failed frame may have become the reference or not; the next one has a reference
        // again.
        EXPECT_TRUE(status == Status::ok || status == Status::no_reference);
        ok += status == Status::ok ? 1 : 0;
      });
  EXPECT_GT(ok, 0);
}

}  // namespace
}  // namespace ktgp_orb
