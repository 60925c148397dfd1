// The parts of the target finder by themselves: which targets are doubtful, and what is stored.
#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "target_world.h"
#include "targets/conflicts.h"
#include "targets/searched_frame.h"
#include "targets/target_store.h"

namespace ktgp_orb::targets {
namespace {

const cv::Size kPoster(200, 150);

TargetFinderOptions oneView() {
  TargetFinderOptions options;
  options.views = 1;
  return options;
}

Target poster(int number, int images = 1) {
  Target target = test::poster(kPoster, number);
  for (int i = 1; i < images; ++i) {
    target.images.push_back(test::poster(kPoster, number + 100 * i).images[0]);
  }
  return target;
}

StoredTarget& add(TargetStore& store, const Target& target) {
  return store.add(target, store.prepare(target, 1));
}

/// So the time for a request does not follow the size of its image.
TEST(SearchedFrame, HasAtMostItsLargestSize) {
  SearchedFrame frame(oneView());
  const cv::Mat tile = test::drawnPicture({640, 480}, 1);
  for (const cv::Size size : {cv::Size(8000, 8000), cv::Size(60000, 10), cv::Size(1300, 900),
                              cv::Size(160, 120), cv::Size(3, 2)}) {
    cv::Mat tiled;
    cv::repeat(tile, size.height / tile.rows + 1, size.width / tile.cols + 1, tiled);
    for (const bool wants_small : {false, true}) {
      frame.set(tiled(cv::Rect({}, size)), wants_small);
      const cv::Size searched = frame.features().image_size;
      EXPECT_LE(std::max(searched.width, searched.height), SearchedFrame::kLargestFrame) << size;
      EXPECT_LE(frame.features().size(), 4000U) << size;
    }
  }
}

/// Up to its largest size, as long as that is worth it.
TEST(SearchedFrame, IsLargerWhereSmallTargetsAreWanted) {
  SearchedFrame frame(oneView());
  for (const auto& [width, scale] :
       {std::pair(160, 4.0), std::pair(320, 3.0), std::pair(640, 2.0), std::pair(1250, 2.0),
        std::pair(1280, 2500.0 / 1280.0), std::pair(1920, 2500.0 / 1920.0), std::pair(2001, 1.0)}) {
    const cv::Mat image = test::drawnPicture({width, 91}, 1);
    frame.set(image, true);
    const cv::Size searched = frame.features().image_size;
    EXPECT_EQ(searched.width, cvRound(scale * width));
    EXPECT_NEAR(frame.scale(), scale, 1e-9);
    // The whole searched frame, from the outer edge of the first pixels to that of the last ones.
    const Eigen::Vector3d last(searched.width - 0.5, searched.height - 0.5, 1.0);
    EXPECT_NEAR((frame.toFrame() * last - Eigen::Vector3d(width - 0.5, 90.5, 1.0)).norm(), 0.0,
                1e-9);
    frame.set(image, false);
    EXPECT_EQ(frame.features().image_size, image.size());
    EXPECT_EQ(frame.scale(), 1.0);
  }
}

/// Two posters and how they were found in a frame.
class Conflicts : public testing::Test {
 protected:
  /// The poster with its upper left corner at x, 100, found by the keypoints `first` ..., whose
  /// points reach over `share` of its width.
  FoundTarget found(StoredTarget& target, double x, int first, int keypoints, double share) const {
    FoundTarget one;
    one.target = &target;
    one.picture = target.pictures[0];
    one.estimate.homography << 1, 0, x, 0, 1, 100, 0, 0, 1;
    one.log_false_alarms = -keypoints;
    one.keypoints.resize(static_cast<std::size_t>(keypoints));
    std::iota(one.keypoints.begin(), one.keypoints.end(), first);
    one.pairs.reference = {{5.0, 5.0}, {share * kPoster.width, kPoster.height - 5.0}};
    for (const Eigen::Vector2d& p : one.pairs.reference) {
      one.pairs.target.emplace_back(p.x() + x, p.y() + 100.0);
      one.pairs.quality.push_back(0.5);
    }
    return one;
  }

  const TargetFinderOptions options_ = oneView();
  TargetStore store_{options_};
  StoredTarget& a_ = add(store_, poster(1));
  StoredTarget& b_ = add(store_, poster(2));
  using Doubtful = std::vector<std::uint8_t>;
};

TEST_F(Conflicts, OfTwoInOnePlaceTheOneWithLessSupportIsDoubtful) {
  // They have no keypoint in common, and each covers its picture.
  EXPECT_EQ(conflicts({found(a_, 50, 0, 40, 0.9), found(b_, 60, 100, 30, 0.9)}, store_),
            (Doubtful{0, 1}));
  EXPECT_EQ(conflicts({found(a_, 50, 0, 30, 0.9), found(b_, 60, 100, 40, 0.9)}, store_),
            (Doubtful{1, 0}));
  // With the same support, it could be either.
  EXPECT_EQ(conflicts({found(a_, 50, 0, 30, 0.9), found(b_, 60, 100, 30, 0.9)}, store_),
            (Doubtful{1, 1}));
  // More than half of the width further, they are two objects that overlap.
  EXPECT_EQ(conflicts({found(a_, 50, 0, 40, 0.9), found(b_, 160, 100, 30, 0.9)}, store_),
            (Doubtful{0, 0}));
}

TEST_F(Conflicts, WhatAgreesLessThanTheTargetAroundItIsDoubtful) {
  // Two parts of one house: the windows of the second one are also within the first one.
  FoundTarget around = found(a_, 50, 0, 40, 0.9);
  FoundTarget inside = found(b_, 160, 100, 30, 0.9);
  around.agreement = 0.9;
  inside.agreement = 0.6;
  // It reaches beyond the first one, but no point that agrees lies there.
  for (Eigen::Vector2d& p : inside.pairs.target) p.x() = std::min(p.x(), 240.0);
  EXPECT_EQ(conflicts({around, inside}, store_), (Doubtful{0, 1}));
  inside.agreement = 0.8;  // a target that lies on the first one
  EXPECT_EQ(conflicts({around, inside}, store_), (Doubtful{0, 0}));
}

TEST_F(Conflicts, InstancesOfOneTargetMayOverlap) {
  EXPECT_EQ(conflicts({found(a_, 50, 0, 40, 0.9), found(a_, 60, 100, 30, 0.9)}, store_),
            (Doubtful{0, 0}));
}

TEST_F(Conflicts, APartInsideAnotherTargetIsNoTarget) {
  // A part of the second one is seen, within the first one: they have this part in common.
  EXPECT_EQ(conflicts({found(a_, 50, 0, 40, 0.9), found(b_, 160, 100, 30, 0.2)}, store_),
            (Doubtful{0, 1}));
  // A target that is seen as a whole may lie on the other one.
  EXPECT_EQ(conflicts({found(a_, 50, 0, 40, 0.9), found(b_, 160, 100, 30, 0.9)}, store_),
            (Doubtful{0, 0}));
  // A part outside of the first one.
  EXPECT_EQ(conflicts({found(a_, 50, 0, 40, 0.9), found(b_, 250, 100, 30, 0.2)}, store_),
            (Doubtful{0, 0}));
}

TEST(TargetStore, TargetsThatComeAndGoLeaveNothing) {
  const TargetFinderOptions options = oneView();
  TargetStore store(options);
  add(store, poster(1));
  std::uint32_t highest = 0;
  for (int i = 0; i < 30; ++i) {
    const Target new_one = poster(2 + i % 3, 1 + i % 2);
    const StoredTarget& target = add(store, new_one);
    highest = std::max(highest, target.pictures.back());
    // The index has its descriptors under these numbers, and none of an earlier target.
    std::vector<IndexHit> hits;
    const std::vector<growth::Bits>& bits = store.picture(target.pictures.back()).frames.bits();
    store.index().search(bits, {0, 1, 2}, hits);
    const auto is_own = [&](const IndexHit& hit) {
      return hit.picture == target.pictures.back() && hit.distance == 0;
    };
    EXPECT_GE(std::count_if(hits.begin(), hits.end(), is_own), 3);
    for (const IndexHit& hit : hits) EXPECT_LE(hit.picture, target.pictures.back());
    store.remove(target);
    for (int frame = 0; frame < 2; ++frame) store.index().optimise();
  }
  EXPECT_EQ(highest, 2U);
  EXPECT_EQ(store.pictureCount(), 1U);
}

}  // namespace
}  // namespace ktgp_orb::targets
