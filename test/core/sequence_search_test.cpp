// The search near the predicted positions in a sequence: the prediction, and when the whole image
// is searched instead.

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cstdlib>
#include <vector>

#include "ktgp_orb/sequence_matcher.h"
#include "moving_view.h"

namespace ktgp_orb {
namespace {

using test::expectTranslation;

constexpr double kRadius = 16.0;
constexpr int kStep =
    30;  // px between frames: more than the radius, so that the prediction is needed

/// The camera's view at (x, y) of the world.
cv::Mat view(int x, int y = 0) {
  return test::viewAt(x, y);
}

SequenceOptions options(double radius, ReferenceMode mode = ReferenceMode::previous) {
  SequenceOptions result;
  result.orb.max_features = 500;
  result.matcher.knn.search_radius = radius;
  result.reference.mode = mode;
  return result;
}

TEST(SequenceSearch, CarriesTheMotionOn) {
  SequenceMatcher near(options(kRadius));
  SequenceMatcher whole(options(0.0));
  for (int i = 0; i < 12; ++i) {
    const SequenceMatch& n = near.match(view(kStep * i, 10 * i), 0.1 * i);
    const SequenceMatch& w = whole.match(view(kStep * i, 10 * i), 0.1 * i);
    EXPECT_EQ(w.match.search, Search::whole);
    EXPECT_EQ(w.fall_backs, 0u);
    if (i == 0) continue;
    ASSERT_EQ(n.match.status, Status::ok) << i;
    expectTranslation(n.match.answer.homography, -kStep, -10);
    // The first motion is unknown; then it is known.
    EXPECT_EQ(n.match.search, i == 1 ? Search::fell_back : Search::near) << i;
    EXPECT_EQ(n.fall_backs, 1u) << i;
    EXPECT_GE(n.match.stages[1].output, w.match.stages[1].output) << i;  // fewer look-alikes
    EXPECT_GE(n.match.inliers, w.match.inliers * 95 / 100) << i;
  }
}

TEST(SequenceSearch, CountsTheTimeBetweenFrames) {
  SequenceMatcher matcher(options(kRadius));
  // After lost frames the camera has moved proportionally farther.
  const int frames[] = {0, 1, 2, 4, 5, 8, 9, 11, 12};
  for (const int i : frames) {
    const SequenceMatch& match = matcher.match(view(kStep * i), 0.05 * i);
    const bool known = i > 1;
    EXPECT_TRUE(!known || match.match.search == Search::near) << i;
  }
}

TEST(SequenceSearch, FallsBackToWhatTheWholeSearchGives) {
  SequenceMatcher near(options(kRadius));
  SequenceMatcher whole(options(0.0));
  const int places[] = {0, 5, 10, 110, 115, 300, 240, 245};  // jumps
  std::uint64_t fall_backs = 0;
  for (int i = 0; i < 8; ++i) {
    const SequenceMatch& n = near.match(view(places[i]), 0.1 * i);
    const SequenceMatch& w = whole.match(view(places[i]), 0.1 * i);
    EXPECT_EQ(n.match.status, w.match.status) << i;
    if (n.match.search != Search::fell_back) continue;
    ++fall_backs;
    EXPECT_EQ(n.match.answer.homography, w.match.answer.homography) << i;
    EXPECT_EQ(n.match.inliers, w.match.inliers) << i;
    EXPECT_EQ(n.match.prosac.mask, w.match.prosac.mask) << i;
  }
  EXPECT_GE(fall_backs, 3u);  // the three jumps at least
  EXPECT_EQ(near.match(view(250), 0.8).fall_backs, fall_backs);
}

TEST(SequenceSearch, LooksForTheSceneThatAKeyframeAndAFixedFrameShow) {
  for (const ReferenceMode mode : {ReferenceMode::keyframe, ReferenceMode::fixed}) {
    SequenceMatcher matcher(options(kRadius, mode));
    if (mode == ReferenceMode::fixed) matcher.fixNextFrame();
    std::uint64_t fall_backs = 0;
    for (int i = 0; i < 7; ++i) {  // up to 120 px from the reference
      const SequenceMatch& match = matcher.match(view(20 * i), 0.1 * i);
      if (i == 0) continue;
      ASSERT_EQ(match.match.status, Status::ok) << i;
      EXPECT_TRUE(i == 1 || match.match.search == Search::near) << i;
      if (i == 1) fall_backs = match.fall_backs;
      EXPECT_EQ(match.fall_backs, fall_backs) << i;
      if (mode == ReferenceMode::fixed) {
        expectTranslation(match.match.answer.homography, -20 * i, 0);
      }
    }
  }
}

TEST(SequenceSearch, SearchesTheWholeImageForAFixedFrameThatWasLost) {
  SequenceMatcher matcher(options(kRadius, ReferenceMode::fixed));
  matcher.fixNextFrame();
  matcher.match(view(0), 0.0);
  matcher.match(view(5), 0.1);
  EXPECT_NE(matcher.match(test::flatImage(test::kView, 128), 0.2).match.status, Status::ok);
  const SequenceMatch& match = matcher.match(view(90), 0.3);
  EXPECT_EQ(match.match.status, Status::ok);
  EXPECT_EQ(match.match.search, Search::whole);
}

TEST(SequenceSearch, KnowsNoMotionAfterAGapAndAReset) {
  SequenceMatcher matcher(options(kRadius));
  for (int i = 0; i < 4; ++i) matcher.match(view(kStep * i), 0.1 * i);
  matcher.match(view(0), 10.0);
  EXPECT_EQ(matcher.match(view(2), 10.1).match.search, Search::near);  // not kStep away
  for (int i = 0; i < 4; ++i) matcher.match(view(kStep * i), 10.2 + 0.1 * i);
  matcher.reset();
  matcher.match(view(0), 10.6);
  EXPECT_EQ(matcher.match(view(2), 10.7).match.search, Search::near);
}

TEST(SequenceSearch, RepeatsItselfForAnyNumberOfThreads) {
  SequenceOptions two = options(kRadius);
  two.orb.threads = two.matcher.knn.threads = 2;
  SequenceMatcher one(options(kRadius));
  SequenceMatcher other(two);
  for (int i = 0; i < 8; ++i) {
    const SequenceMatch& a = one.match(view(kStep * i), 0.1 * i);
    const SequenceMatch& b = other.match(view(kStep * i), 0.1 * i);
    EXPECT_EQ(a.match.answer.homography, b.match.answer.homography);
    EXPECT_EQ(a.match.search, b.match.search);
  }
}

}  // namespace
}  // namespace ktgp_orb
