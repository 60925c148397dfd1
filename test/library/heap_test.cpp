// Heap use of a live sequence: once the buffers have grown, from image to match, no code allocates,
// OpenCV and Eigen included. Counts malloc itself, which only glibc lets a program replace.

#include <gtest/gtest.h>

#include <atomic>
#include <cstddef>
#include <ostream>
#include <string>
#include <vector>

#include "frame_pair.h"
#include "ktgp_orb/growth.h"
#include "ktgp_orb/sequence_matcher.h"
#include "orb_test_images.h"
#include "watched_malloc.h"

#ifdef KTGP_ORB_WATCHES_MALLOC

namespace {
std::atomic<std::size_t> calls{0};
}

void ktgp_orb::test::onAllocation() {
  ++calls;
}

namespace ktgp_orb {
namespace {

TEST(HeapCounter, CountsMatrices) {
  const std::size_t before = calls;
  const cv::Mat image(100, 100, CV_8U);
  EXPECT_GT(calls - before, 0u);
}

/// Options that a sequence is matched with.
struct Case {
  const char* name;
  void (*change)(SequenceOptions&);
};

void PrintTo(const Case& c, std::ostream* out) {
  *out << c.name;
}

class Heap : public testing::TestWithParam<Case> {};

TEST_P(Heap, NoAllocationInSteadyState) {
  SequenceOptions options;
  options.orb.max_features = 200;
  options.matcher.alignment.points = 50;
  GetParam().change(options);
  const cv::Mat world = test::textureImage(cv::Size(500, 300), 1);
  std::vector<cv::Mat> views;
  for (int i = 0; i < 8; ++i) views.push_back(world(cv::Rect(6 * i, 3 * i, 200, 160)).clone());
  SequenceMatcher matcher(options);
  int n = 0;
  std::size_t matched = 0;
  const auto run = [&](int frames) {
    for (int i = 0; i < frames; ++i, ++n) {
      // Back and forth, with an occasional jump, so that the whole image is searched, too.
      const int at = n % 50 == 0 ? 7 : std::abs(n % 14 - 7);
      const SequenceMatch& match = matcher.match(views[static_cast<std::size_t>(at)], 0.1 * n);
      matched += match.match.status == Status::ok ? 1 : 0;
    }
  };
  run(350);  // 14 views, a jump each 50 frames: they repeat after 350
  const std::size_t before = calls;
  run(700);
  EXPECT_EQ(calls - before, 0u);
  EXPECT_GT(matched, 900u);
}

INSTANTIATE_TEST_SUITE_P(
    EveryStage, Heap,
    testing::Values(
        Case{"ktgp", [](SequenceOptions&) {}},
        Case{"threads", [](SequenceOptions& o) { o.orb.threads = o.matcher.knn.threads = 3; }},
        Case{"uniform",
             [](SequenceOptions& o) { o.orb.distribution = KeypointDistribution::uniform; }},
        Case{"teblid", [](SequenceOptions& o) { o.orb.descriptor = DescriptorKind::teblid; }},
        Case{"near", [](SequenceOptions& o) { o.matcher.knn.search_radius = 16.0; }},
        Case{"near_keyframe",
             [](SequenceOptions& o) {
               o.matcher.knn.search_radius = 16.0;
               o.reference.mode = ReferenceMode::keyframe;
             }},
        Case{"all",
             [](SequenceOptions& o) {
               o.matcher.knn.search_radius = 16.0;
               o.matcher.mutual = true;
               o.matcher.guided.enabled = true;
               o.matcher.gms.rotation = o.matcher.gms.scale = true;
               o.reference.mode = ReferenceMode::keyframe;
             }}),
    [](const auto& info) { return std::string(info.param.name); });

TEST(GrowthsHeap, NoAllocationInSteadyState) {
  const cv::Mat image = test::textureImage(cv::Size(640, 480), 1);
  const auto [reference, target] =
      test::FramePair(image, test::textureImage(cv::Size(640, 480), 2));
  const ReferenceViews views = simulateViews(image, {}, 5);
  std::vector<Correspondence> matches;
  KnnMatcher().matchMutual(reference.descriptors, target.descriptors, matches);
  HomographyGrowth growth;
  GrowthResult result;
  growth.find(reference, &views, target, matches, result);
  ASSERT_GT(result.seeds, 0);
  const std::size_t before = calls;
  growth.find(reference, &views, target, matches, result);
  EXPECT_EQ(calls - before, 0u);
}

}  // namespace
}  // namespace ktgp_orb

#endif
