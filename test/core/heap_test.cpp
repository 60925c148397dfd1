// Heap use of a live sequence: from frame 1000 on, from image to match, no code allocates, OpenCV
// and Eigen included. Counts malloc itself, which only glibc lets a program replace.

#include <gtest/gtest.h>

#include <atomic>
#include <cstddef>
#include <vector>

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

TEST(Heap, IsCounted) {
  const std::size_t before = calls;
  const cv::Mat image(100, 100, CV_8U);
  EXPECT_GT(calls - before, 0u);
}

/// Number of allocator calls in a thousand frames, after the buffers have grown.
std::size_t callsInAThousandFrames(const SequenceOptions& options) {
  const cv::Mat world = test::textureImage(cv::Size(500, 300), 1);
  std::vector<cv::Mat> views;
  for (int i = 0; i < 8; ++i) views.push_back(world(cv::Rect(6 * i, 3 * i, 200, 160)).clone());
  SequenceMatcher matcher(options);
  int n = 0;
  const auto run = [&](int frames) {
    for (int i = 0; i < frames; ++i, ++n) {
      // Back and forth, with an occasional jump.
      const int at = n % 50 == 0 ? 7 : std::abs(n % 14 - 7);
      matcher.match(views[static_cast<std::size_t>(at)], 0.1 * n);
    }
  };
  run(200);
  const std::size_t before = calls;
  run(1000);
  return calls - before;
}

TEST(Heap, IsLeftAloneInSteadyState) {
  SequenceOptions options;
  options.orb.max_features = 200;
  EXPECT_EQ(callsInAThousandFrames(options), 0u);
  options.matcher.knn.search_radius = 16.0;
  EXPECT_EQ(callsInAThousandFrames(options), 0u) << "near the prediction";
  options.matcher.mutual = true;
  options.matcher.guided.enabled = true;
  options.matcher.gms.rotation = options.matcher.gms.scale = true;
  EXPECT_EQ(callsInAThousandFrames(options), 0u) << "with all that can be switched on";
}

}  // namespace
}  // namespace ktgp_orb

#endif
