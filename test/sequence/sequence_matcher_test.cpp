// References of the frames of a sequence, reasons for missing references, and accumulated
// homographies.

#include "ktgp_orb/sequence_matcher.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>
#include <set>
#include <stdexcept>
#include <vector>

#include "homography/transform.h"
#include "ktgp_orb/frame_path.h"
#include "ktgp_orb/metrics.h"
#include "moving_view.h"
#include "orb_test_images.h"
#include "sequence/motion_predictor.h"
#include "synthetic_pairs.h"

namespace ktgp_orb {
namespace {

using homography::chained;
using sequence::MotionPredictor;

using test::expectTranslation;
using test::frameOf;
using test::sequenceOf;

constexpr int kStepX = 5;  // px that the camera moves from view to view
constexpr int kStepY = 3;

/// The camera's view after `i` steps to the right and down.
cv::Mat view(int i) {
  return test::viewAt(kStepX * i, kStepY * i);
}

/// A view with only the columns from `begin` to `end` (shares of the width) visible.
cv::Mat partOfView(double begin, double end) {
  cv::Mat image = view(0);
  image.colRange(0, static_cast<int>(begin * test::kView.width)).setTo(128);
  image.colRange(static_cast<int>(end * test::kView.width), test::kView.width).setTo(128);
  return image;
}

TEST(SequenceMatcher, MatchesEveryFrameToTheOneBefore) {
  SequenceMatcher matcher(sequenceOf(ReferenceMode::previous));
  for (int i = 0; i < 6; ++i) {
    const SequenceMatch& match = matcher.match(view(i), 1e9 + 0.1 * i);
    EXPECT_EQ(match.frame->stamp, 1'000'000'000'000'000'000 + 100'000'000 * i);
    if (i == 0) {
      EXPECT_EQ(match.no_reference, NoReference::first_frame);
      EXPECT_EQ(match.match.status, Status::no_reference);
      EXPECT_FALSE(match.reference);
      continue;
    }
    EXPECT_EQ(match.no_reference, NoReference::none);
    ASSERT_EQ(match.match.status, Status::ok);
    EXPECT_EQ(match.reference->stamp, match.frame->stamp - 100'000'000);
    EXPECT_TRUE(match.reference_changed);
    expectTranslation(match.match.answer.homography, -kStepX, -kStepY);
    ASSERT_TRUE(match.accumulated);
    EXPECT_EQ(match.first_stamp, 1'000'000'000'000'000'000);
    expectTranslation(match.accumulated->homography, -kStepX * i, -kStepY * i, 0.2 * i);
  }
}

// A patch of ORB is as large as half of this reference.
TEST(SequenceMatcher, SmallFixedReferenceIsEnlarged) {
  const cv::Mat picture = test::blockImage(cv::Size(340, 260), 3, 60);
  const cv::Rect where(130, 90, 76, 70);
  for (const int enlarge_below : {0, 160}) {
    SequenceOptions options;
    options.orb.max_features = 5000;
    options.orb.distribution = KeypointDistribution::uniform;
    options.matcher = MatcherOptions::robust();
    options.reference.mode = ReferenceMode::fixed;
    options.reference.enlarge_below = enlarge_below;
    SequenceMatcher matcher(options);
    matcher.setFixedReference(frameOf(matcher, picture(where).clone()));
    for (int i = 0; i < 4; ++i) {
      const cv::Rect seen(kStepX * i, kStepY * i, test::kView.width, test::kView.height);
      const SequenceMatch& match = matcher.match(picture(seen).clone(), 0.1 * i);
      EXPECT_EQ(match.match.status == Status::ok, enlarge_below > 0) << i;
      if (match.match.status != Status::ok) continue;
      expectTranslation(match.match.answer.homography, where.x - seen.x, where.y - seen.y);
      EXPECT_EQ(match.frame->features.image_size, test::kView);
    }
  }
}

TEST(SequenceMatcher, OnlyASmallReferenceEnlargesTheFrames) {
  SequenceOptions options = sequenceOf(ReferenceMode::fixed);
  options.reference.enlarge_below = 160;
  SequenceMatcher matcher(options);
  for (const int side : {75, 200, 75, 200}) {
    matcher.setFixedReference(frameOf(matcher, view(0)(cv::Rect(0, 0, side, side)).clone()));
    const SequenceMatch& match = matcher.match(view(0), side);
    EXPECT_EQ(match.frame->orb->first_level, side == 75 ? 7 : 0);
    EXPECT_EQ(match.frame->orb->levels, side == 75 ? 15 : 8);
    // Features of the matcher's options, as a worker finds them.
    const FramePtr frame = frameOf(matcher, view(0));
    OrbExtractor extractor(matcher.options().orb);
    extractFeatures(extractor, *frame);
    MatchAhead ahead;  // match of the features that the matcher finds anew
    ahead.reference = matcher.fixedReference();
    ahead.result.correspondences = {{1, 1000000, 0, 0}};
    const SequenceMatch& again = matcher.match(frame, side == 75 ? &ahead : nullptr);
    EXPECT_EQ(again.frame == frame, side != 75);
    for (const Correspondence& c : again.match.correspondences) {
      ASSERT_LT(static_cast<std::size_t>(c.target_index), again.frame->features.size());
    }
  }
  matcher.setFixedReference(frameOf(matcher, view(0)(cv::Rect(0, 0, 75, 75)).clone()));
  // At most 2500 px, and not with TEBLID.
  EXPECT_EQ(matcher.match(cv::Mat::zeros(900, 1300, CV_8U), 900.0).frame->orb->first_level, 3);
  EXPECT_EQ(matcher.match(cv::Mat::zeros(900, 2600, CV_8U), 901.0).frame->orb->first_level, 0);
  options.orb.descriptor = DescriptorKind::teblid;
  matcher.setOptions(options);
  EXPECT_EQ(matcher.match(view(0), 902.0).frame->orb->first_level, 0);
  options.orb.descriptor = DescriptorKind::orb;
  matcher.setOptions(options);
  // A frame that becomes the reference is enlarged at once, also after one that was not small.
  matcher.setFixedReference(frameOf(matcher, view(0)));
  matcher.fixNextFrame();
  EXPECT_EQ(matcher.match(view(0)(cv::Rect(0, 0, 300, 60)).clone(), 1000.0).frame->orb->first_level,
            7);
}

// The camera moves by whole pixels, so a keypoint stays at its place in the world.
TEST(SequenceMatcher, TrackStaysWithItsKeypoint) {
  for (const ReferenceMode mode :
       {ReferenceMode::previous, ReferenceMode::keyframe, ReferenceMode::fixed}) {
    SequenceMatcher matcher(sequenceOf(mode));
    std::map<std::uint64_t, cv::Point2f> places;
    std::map<std::uint64_t, int> ages;
    matcher.fixNextFrame();
    for (int i = 0; i < 8; ++i) {
      const SequenceMatch& match = matcher.match(view(i), 0.1 * i);
      const Frame& frame = *match.frame;
      ASSERT_EQ(frame.tracks.size(), frame.features.size());
      EXPECT_EQ(std::set(frame.tracks.begin(), frame.tracks.end()).size(), frame.tracks.size());
      for (std::size_t k = 0; k < frame.tracks.size(); ++k) {
        const cv::Point2f place =
            frame.features.keypoints[k].pt + cv::Point2f(float(kStepX * i), float(kStepY * i));
        const auto [known, is_new] = places.try_emplace(frame.tracks[k], place);
        EXPECT_LT(cv::norm(known->second - place), 3.0 * (i + 1));
        ++ages[frame.tracks[k]];
      }
      for (const Correspondence& c : match.match.correspondences) {
        if (c.level < Level::ktgp) continue;
        const std::uint64_t track = frame.tracks[static_cast<std::size_t>(c.target_index)];
        const std::uint64_t before =
            match.reference->tracks[static_cast<std::size_t>(c.reference_index)];
        EXPECT_TRUE(track == before || ages[track] == 1) << "one of several matches goes on";
      }
    }
    const auto lasting = std::count_if(ages.begin(), ages.end(),
                                       [](const auto& track) { return track.second == 8; });
    EXPECT_GT(lasting, 10) << "mode " << static_cast<int>(mode);
    // Another sequence does not go on with the tracks of this one.
    matcher.reset();
    const SequenceMatch& first = matcher.match(view(7), 1.0);
    for (const std::uint64_t track : first.frame->tracks) EXPECT_EQ(places.count(track), 0U);
  }
}

TEST(SequenceMatcher, TheTimeOfExtractionIsInMilliseconds) {
  OrbExtractor extractor;
  Frame frame;
  frame.image = view(0);
  double share =
      0.0;  // share of the call's time; nearly all, unless each repetition was interrupted
  for (int i = 0; i < 20; ++i) {
    const auto start = std::chrono::steady_clock::now();
    extractFeatures(extractor, frame);
    const std::chrono::duration<double, std::milli> whole =
        std::chrono::steady_clock::now() - start;
    EXPECT_LE(frame.extraction_milliseconds, whole.count());
    share = std::max(share, frame.extraction_milliseconds / whole.count());
  }
  EXPECT_GT(share, 0.5);
}

// The reference has descriptors of the old kind: its features are found again.
TEST(SequenceMatcher, MatchesAcrossAChangeOfDescriptor) {
  SequenceOptions options = sequenceOf(ReferenceMode::previous);
  SequenceMatcher matcher(options);
  matcher.match(view(0), 0.0);
  options.orb.descriptor = DescriptorKind::teblid;
  matcher.setOptions(options);
  const SequenceMatch& match = matcher.match(view(1), 0.1);
  ASSERT_EQ(match.match.status, Status::ok);
  EXPECT_EQ(match.match.descriptor, DescriptorKind::teblid);
  EXPECT_EQ(match.reference->features.descriptor, DescriptorKind::teblid);
  expectTranslation(match.match.prosac.answer.homography, -kStepX, -kStepY);
}

// There is no image to extract other features from, and the two kinds cannot be compared.
TEST(SequenceMatcher, FeaturesOfAnotherDescriptorBeginANewSequence) {
  OrbOptions options;
  const auto found = [&](int i) {
    Features features;
    OrbExtractor(options).extract(view(i), features);
    return features;
  };
  for (const ReferenceMode mode : {ReferenceMode::previous, ReferenceMode::keyframe}) {
    SequenceMatcher matcher(sequenceOf(mode));
    options.descriptor = DescriptorKind::orb;
    matcher.match(found(0), 0.0);
    EXPECT_EQ(matcher.match(found(1), 0.1).match.status, Status::ok);
    options.descriptor = DescriptorKind::teblid;
    EXPECT_EQ(matcher.match(found(2), 0.2).no_reference, NoReference::encoding_changed);
    EXPECT_EQ(matcher.match(found(3), 0.3).match.status, Status::ok);
  }
}

TEST(SequenceMatcher, RefusesFeaturesOfAnotherDescriptorThanTheFixedReference) {
  OrbOptions options;
  Features teblid;
  options.descriptor = DescriptorKind::teblid;
  OrbExtractor(options).extract(view(1), teblid);
  SequenceMatcher matcher(sequenceOf(ReferenceMode::fixed));
  matcher.setFixedReference(frameOf(matcher, view(0)));
  EXPECT_THROW(matcher.match(teblid, 0.1), std::invalid_argument);
}

TEST(SequenceMatcher, EqualsTheStagesCalledByHand) {
  const SequenceOptions options = sequenceOf(ReferenceMode::previous);
  OrbExtractor extractor(options.orb);
  KtgpMatcher ktgp(options.matcher);
  SequenceMatcher of_images(options);
  SequenceMatcher of_features(options);
  Features before;
  Features now;
  MatchResult expected;
  for (int i = 0; i < 4; ++i) {
    extractor.extract(view(i), now);
    const MatchResult& from_image = of_images.match(view(i), i * 0.1).match;
    const MatchResult& from_features = of_features.match(now, i * 0.1).match;
    if (i > 0) {
      ktgp.match(before, now, expected);
      for (const MatchResult* result : {&from_image, &from_features}) {
        EXPECT_EQ(result->answer.homography, expected.answer.homography);
        EXPECT_EQ(result->prosac.mask, expected.prosac.mask);
        EXPECT_EQ(result->correspondences.size(), expected.correspondences.size());
      }
    }
    std::swap(before, now);
  }
}

TEST(SequenceMatcher, SaysWhyThereIsNoReference) {
  SequenceMatcher matcher(sequenceOf(ReferenceMode::previous));
  const auto reason = [&](int i, double seconds, const std::string& encoding = "mono8") {
    const SequenceMatch& match = matcher.match(view(i), seconds, encoding);
    EXPECT_EQ(match.match.status == Status::no_reference, !match.reference);
    EXPECT_EQ(match.accumulated.has_value(), match.match.status == Status::ok);
    return match.no_reference;
  };
  EXPECT_EQ(reason(0, 10.0), NoReference::first_frame);
  EXPECT_EQ(reason(1, 11.0), NoReference::none) << "as old as it may be";
  EXPECT_EQ(reason(2, 12.000001), NoReference::gap);
  EXPECT_EQ(reason(3, 12.1), NoReference::none);
  EXPECT_EQ(reason(4, 12.0), NoReference::stamp_went_back);
  EXPECT_EQ(reason(5, 12.0), NoReference::none) << "two frames may have one stamp";
  EXPECT_EQ(reason(6, 12.1, "bgr8"), NoReference::encoding_changed);
  EXPECT_EQ(reason(7, 12.2, "bgr8"), NoReference::none);
  const cv::Mat smaller = view(8).colRange(0, test::kView.width - 8);
  EXPECT_EQ(matcher.match(smaller, 12.3, "bgr8").no_reference, NoReference::size_changed);
  matcher.reset();
  EXPECT_EQ(matcher.match(smaller, 12.4, "bgr8").no_reference, NoReference::reset);
  matcher.restart();
  EXPECT_EQ(reason(8, 12.5), NoReference::first_frame);
  matcher.setOptions(sequenceOf(ReferenceMode::keyframe));
  EXPECT_EQ(reason(9, 12.6), NoReference::mode_changed);
  EXPECT_EQ(reason(10, 12.7), NoReference::none);
  matcher.setOptions(sequenceOf(ReferenceMode::fixed));
  EXPECT_EQ(reason(11, 12.8), NoReference::not_set);
  EXPECT_EQ(reason(12, 12.9), NoReference::not_set);
  matcher.setOptions(sequenceOf(ReferenceMode::previous));
  EXPECT_EQ(reason(13, 13.0), NoReference::mode_changed);
  EXPECT_EQ(reason(14, 13.1), NoReference::none);
  // The largest possible step of stamps.
  EXPECT_EQ(reason(15, 9.1e9), NoReference::gap);
  EXPECT_EQ(reason(15, -9.1e9), NoReference::stamp_went_back);
  EXPECT_EQ(reason(15, -9.0e9), NoReference::gap) << "two that follow each other are believed";
  EXPECT_EQ(reason(15, 9.1e9), NoReference::gap);
}

TEST(SequenceMatcher, NamesEveryReason) {
  std::set<std::string> names;
  for (int i = 0; i <= static_cast<int>(NoReference::lens_changed); ++i) {
    names.insert(toString(static_cast<NoReference>(i)));
  }
  EXPECT_EQ(names.size(), 10u);
  EXPECT_EQ(names.count("unknown"), 0u);
  EXPECT_STREQ(toString(NoReference::stamp_went_back), "stamp_went_back");
}

TEST(SequenceMatcher, BlankFrameBreaksTheChain) {
  SequenceMatcher matcher(sequenceOf(ReferenceMode::previous));
  matcher.match(view(0), 0.0);
  matcher.match(view(1), 0.1);
  const SequenceMatch& lost = matcher.match(test::flatImage(test::kView, 128), 0.2);
  EXPECT_EQ(lost.match.status, Status::too_few_features);
  EXPECT_TRUE(lost.reference);
  EXPECT_FALSE(lost.accumulated);
  EXPECT_FALSE(matcher.match(view(3), 0.3).accumulated);
  const SequenceMatch& found = matcher.match(view(4), 0.4);
  ASSERT_TRUE(found.accumulated);
  EXPECT_EQ(found.first_stamp, 300'000'000);
}

TEST(SequenceMatcher, KeyframeStaysWhileItOverlaps) {
  SequenceOptions options = sequenceOf(ReferenceMode::keyframe);
  options.reference.min_overlap = 0.9;
  options.reference.min_inliers = 10;
  SequenceMatcher matcher(options);
  // After three steps it covers (1 - 15/320)(1 - 9/240) = 0.917 of the frame, after four 0.891.
  for (int i = 0; i < 12; ++i) {
    const SequenceMatch& match = matcher.match(view(i), 0.1 * i);
    if (i == 0) continue;
    ASSERT_EQ(match.match.status, Status::ok);
    const int keyframe = (i - 1) / 3 * 3;
    EXPECT_EQ(match.reference->stamp, 100'000'000 * keyframe) << "frame " << i;
    EXPECT_EQ(match.reference_changed, i % 3 == 1) << "frame " << i;
    expectTranslation(match.accumulated->homography, -kStepX * i, -kStepY * i, 0.2 * i);
  }
}

TEST(SequenceMatcher, WeakKeyframeStaysIfPreviousFrameDoesNotMatch) {
  SequenceOptions options = sequenceOf(ReferenceMode::keyframe);
  options.orb.max_features = 1000;
  options.reference.min_inliers = 4;
  SequenceMatcher matcher(options);
  matcher.match(partOfView(0.0, 1.0), 1.0);
  const std::size_t left = matcher.match(partOfView(0.0, 0.6), 1.1).match.inliers;
  const SequenceMatch answer = matcher.match(partOfView(0.7, 1.0), 1.2);
  ASSERT_EQ(answer.match.status, Status::ok);
  const std::size_t right = answer.match.inliers;
  ASSERT_LT(right, left);

  // The same with a limit that the third frame does not reach. The third frame has nothing in
  // common with the second one, which is tried next, so the keyframe's match must stay.
  options.reference.min_inliers = static_cast<int>((left + right) / 2);
  matcher = SequenceMatcher(options);
  matcher.match(partOfView(0.0, 1.0), 1.0);
  matcher.match(partOfView(0.0, 0.6), 1.1);
  const SequenceMatch& weak = matcher.match(partOfView(0.7, 1.0), 1.2);
  EXPECT_EQ(weak.match.status, Status::ok);
  EXPECT_EQ(weak.reference->stamp, 1'000'000'000);
  EXPECT_EQ(weak.match.answer.homography, answer.match.answer.homography);
  ASSERT_TRUE(weak.accumulated);
  EXPECT_EQ(weak.first_stamp, 1'000'000'000);
  double stages = 0.0;
  for (const StageResult& stage : weak.match.stages) stages += stage.milliseconds;
  EXPECT_GT(weak.total_milliseconds, weak.frame->extraction_milliseconds + stages)
      << "both matches take their time";
}

TEST(SequenceMatcher, FixedReferenceStaysUntilReset) {
  SequenceMatcher matcher(sequenceOf(ReferenceMode::fixed));
  matcher.match(view(0), 0.0);
  matcher.fixNextFrame();
  const SequenceMatch& itself = matcher.match(view(4), 0.1);
  EXPECT_EQ(itself.reference, itself.frame);
  expectTranslation(itself.match.answer.homography, 0.0, 0.0);
  for (int i : {7, 2, 5}) {
    const SequenceMatch& match = matcher.match(view(i), 1000.0 + 0.1 * i, "any");
    EXPECT_EQ(match.reference->stamp, 100'000'000);
    expectTranslation(match.match.answer.homography, -kStepX * (i - 4), -kStepY * (i - 4));
    EXPECT_FALSE(match.accumulated);
  }
  matcher.reset();
  EXPECT_EQ(matcher.match(view(4), 0.1).no_reference, NoReference::not_set);
  const FramePtr target = frameOf(matcher, view(3));
  matcher.setFixedReference(target);
  expectTranslation(matcher.match(view(4), 0.2).match.answer.homography, -kStepX, -kStepY);
  EXPECT_EQ(matcher.fixedReference(), target);
}

/// For a reference that stays, with simulated views.
SequenceOptions withViews(bool in_background) {
  SequenceOptions options = sequenceOf(ReferenceMode::fixed);
  options.matcher = MatcherOptions::robust();
  options.matcher.growth.views = 13;
  options.views_in_background = in_background;
  return options;
}

FramePtr referenceOf(SequenceMatcher& matcher, const cv::Size& size, std::uint64_t seed) {
  const FramePtr frame = matcher.newFrame();
  frame->image = test::drawnPicture(size, seed);
  return frame;
}

/// Two frames in turn: an image that repeats the last one is no new frame.
const SequenceMatch& matchPart(SequenceMatcher& matcher, const cv::Mat& whole, int i) {
  return matcher.match(whole(cv::Rect(20 + i % 2, 10, 180, 150)).clone(), 1.0 + 0.03 * i);
}

/// Counts frames, not time: whoever waits has none while the views are made.
TEST(SequenceMatcher, FramesDoNotWaitForTheViewsOfALargeReference) {
  for (const cv::Size& size : {cv::Size(12000, 200), cv::Size(4000, 3000)}) {
    SequenceMatcher matcher(withViews(true));
    EXPECT_EQ(matcher.viewsState(), ViewsState::none);
    const FramePtr reference = referenceOf(matcher, size, 3);
    matcher.setFixedReference(reference);
    int meanwhile = 0;
    while (matcher.viewsState() != ViewsState::ready) {
      const SequenceMatch& match = matchPart(matcher, reference->image, meanwhile++);
      ASSERT_TRUE(match.reference);
      if (meanwhile == 1) {
        EXPECT_EQ(matcher.viewsState(), ViewsState::being_made);
      }
    }
    std::printf("%dx%d: %d frames meanwhile\n", size.width, size.height, meanwhile);
    EXPECT_GT(meanwhile, 2);

    SequenceMatcher waiting(withViews(false));
    waiting.setFixedReference(referenceOf(waiting, size, 3));
    const MatchResult& now = matchPart(matcher, reference->image, meanwhile).match;
    const MatchResult& then = matchPart(waiting, reference->image, meanwhile).match;
    EXPECT_EQ(waiting.viewsState(), ViewsState::ready);
    EXPECT_EQ(now.status, then.status);
    EXPECT_EQ(now.answer.homography, then.answer.homography) << "with the views the same bits";
  }
}

TEST(SequenceMatcher, ViewsAreThoseOfTheNewestReference) {
  const cv::Size size(900, 700);
  SequenceMatcher matcher(withViews(true));
  matcher.setFixedReference(referenceOf(matcher, size, 4));
  const cv::Mat whole = test::drawnPicture(size, 5);
  matchPart(matcher, whole, 0);
  ASSERT_EQ(matcher.viewsState(), ViewsState::being_made);
  matcher.setFixedReference(referenceOf(matcher, size, 5));
  int i = 1;
  do {
    matchPart(matcher, whole, i++);
  } while (matcher.viewsState() != ViewsState::ready);
  SequenceMatcher waiting(withViews(false));
  waiting.setFixedReference(referenceOf(waiting, size, 5));
  const MatchResult& now = matchPart(matcher, whole, i).match;
  const MatchResult& then = matchPart(waiting, whole, i).match;
  EXPECT_EQ(now.status, then.status);
  EXPECT_EQ(now.answer.homography, then.answer.homography);
  matcher.reset();
  EXPECT_EQ(matcher.viewsState(), ViewsState::none);
}

TEST(SequenceMatcher, OnlyOtherFeaturesOrViewsDiscardTheViews) {
  SequenceMatcher matcher(withViews(false));
  const FramePtr reference = referenceOf(matcher, cv::Size(900, 700), 6);
  matcher.setFixedReference(reference);
  matchPart(matcher, reference->image, 0);
  ASSERT_EQ(matcher.viewsState(), ViewsState::ready);
  SequenceOptions options = withViews(true);
  options.matcher.prosac.max_error = 2.0;
  matcher.setOptions(options);
  matchPart(matcher, reference->image, 1);
  EXPECT_EQ(matcher.viewsState(), ViewsState::ready);
  options.orb.max_features += 100;
  matcher.setOptions(options);
  matchPart(matcher, reference->image, 2);
  EXPECT_EQ(matcher.viewsState(), ViewsState::being_made);
  options.matcher.growth.enabled = false;  // no views are needed any more
  matcher.setOptions(options);
  matchPart(matcher, reference->image, 3);
  EXPECT_EQ(matcher.viewsState(), ViewsState::none);
}

TEST(SequenceMatcher, RestartKeepsTheRequestForAFixedReference) {
  SequenceMatcher matcher(sequenceOf(ReferenceMode::fixed));
  matcher.fixNextFrame();
  matcher.match(view(0), 1.0);
  matcher.fixNextFrame();
  matcher.restart();
  matcher.match(view(1), 2.0);
  ASSERT_TRUE(matcher.fixedReference());
  EXPECT_EQ(matcher.fixedReference()->stamp, 2'000'000'000);
}

TEST(SequenceMatcher, MatchAheadNeedsItsReference) {
  const SequenceOptions options = withImages(sequenceOf(ReferenceMode::previous));
  OrbExtractor extractor(options.orb);
  std::vector<FramePtr> frames;
  for (int i = 0; i < 3; ++i) {
    frames.push_back(std::make_shared<Frame>());
    frames[i]->image = view(i);
    frames[i]->stamp = i;
    extractFeatures(extractor, *frames[i]);
  }
  KtgpMatcher ktgp(options.matcher);
  MatchAhead stale{frames[0], {}};
  ktgp.match(frames[0]->features, frames[2]->features, stale.result);
  SequenceMatcher matcher(options);
  matcher.match(frames[0]);
  matcher.match(frames[1]);
  const SequenceMatch& match = matcher.match(frames[2], &stale);
  EXPECT_EQ(match.reference, frames[1]);
  expectTranslation(match.match.answer.homography, -kStepX, -kStepY);

  // A match computed in advance for the right reference is used.
  MatchAhead ahead{frames[1], {}};
  ktgp.match(frames[1]->features, frames[2]->features, ahead.result);
  ahead.result.rmse = 1234.5;
  matcher = SequenceMatcher(options);
  matcher.match(frames[0]);
  matcher.match(frames[1]);
  EXPECT_EQ(matcher.match(frames[2], &ahead).match.rmse, 1234.5);
}

TEST(SequenceMatcher, TheCallersImageMayChangeAfterTheCall) {
  SequenceOptions options = sequenceOf(ReferenceMode::previous);
  SequenceMatcher matcher(options);
  cv::Mat buffer = view(0);
  matcher.match(buffer, 0.0);
  view(1).copyTo(buffer);
  options.orb.max_features = 400;  // the reference's features are extracted again from its image
  matcher.setOptions(options);
  expectTranslation(matcher.match(buffer, 0.1).match.answer.homography, -kStepX, -kStepY);
}

TEST(SequenceMatcher, FramesThatTheCallerKeepsStayAsTheyAre) {
  SequenceMatcher matcher(sequenceOf(ReferenceMode::previous));
  std::vector<FrameConstPtr> kept;
  for (int i = 0; i < 15; ++i) kept.push_back(matcher.match(view(i), 0.1 * i).frame);
  OrbExtractor extractor(sequenceOf(ReferenceMode::previous).orb);
  Features features;
  for (int i = 0; i < 15; ++i) {
    extractor.extract(view(i), features);
    EXPECT_EQ(kept[i]->stamp, 100'000'000 * i);
    EXPECT_EQ(cv::norm(kept[i]->image, view(i), cv::NORM_INF), 0.0);
    EXPECT_EQ(cv::norm(kept[i]->features.descriptors, features.descriptors, cv::NORM_INF), 0.0);
  }
}

TEST(SequenceMatcher, LetsGoOfImagesThatItNeedsNoMore) {
  SequenceMatcher matcher(sequenceOf(ReferenceMode::previous));
  std::vector<std::weak_ptr<const void>> sources;
  const auto send = [&](int i) {
    const auto pixels = std::make_shared<cv::Mat>(view(i));
    const FramePtr frame = frameOf(matcher, *pixels);
    frame->source = pixels;
    frame->stamp = 1000 * i;
    sources.emplace_back(pixels);
    matcher.match(frame);
  };
  for (int i = 0; i < 10; ++i) send(i);
  for (int i = 0; i < 8; ++i) EXPECT_TRUE(sources[i].expired()) << "frame " << i;
  EXPECT_FALSE(sources[9].expired());
  matcher.restart();
  EXPECT_TRUE(sources[8].expired());
  EXPECT_TRUE(sources[9].expired());
}

TEST(SequenceMatcher, RefusesInvalidTimesImagesAndFeatures) {
  SequenceMatcher matcher(sequenceOf(ReferenceMode::previous));
  matcher.match(view(0), 1.0);
  EXPECT_THROW(matcher.match(view(1), std::nan("")), std::invalid_argument);
  EXPECT_THROW(matcher.match(view(1), 1e10), std::invalid_argument);
  EXPECT_THROW(matcher.match(cv::Mat(test::kView, CV_8UC3), 1.1), std::invalid_argument);
  Features features;
  features.keypoints.resize(3);
  EXPECT_THROW(matcher.match(features, 1.1), std::invalid_argument);
  const SequenceMatch& match = matcher.match(view(1), 1.1);
  ASSERT_TRUE(match.reference) << "a refused frame never was";
  EXPECT_EQ(match.reference->stamp, 1'000'000'000);
}

// A chain of homographies with a known covariance: the spread of the products over many random
// errors must equal the propagated one.
TEST(HomographyChain, CovarianceIsTheSpreadOfTheProducts) {
  using Vector8 = Eigen::Matrix<double, 8, 1>;
  cv::RNG random(5);
  UncertainHomography link;
  link.homography << 1.01, 0.02, -5.0, -0.015, 0.99, 3.0, 2e-5, -1e-5, 1.0;
  Vector8 sigma;
  sigma << 1e-4, 1e-4, 0.05, 1e-4, 1e-4, 0.05, 2e-7, 2e-7;
  // Correlated, to detect a transposed derivative.
  Eigen::Matrix<double, 8, 8> root = sigma.asDiagonal();
  for (int i = 1; i < 8; ++i) root(i, i - 1) = 0.6 * sigma(i);
  link.covariance = root * root.transpose();

  constexpr int kLinks = 5;
  UncertainHomography expected{Eigen::Matrix3d::Identity()};
  for (int i = 0; i < kLinks; ++i) expected = chained(link, expected);

  constexpr int kTrials = 20000;
  Eigen::Matrix<double, 8, 8> spread = Eigen::Matrix<double, 8, 8>::Zero();
  for (int trial = 0; trial < kTrials; ++trial) {
    UncertainHomography product{Eigen::Matrix3d::Identity()};
    for (int i = 0; i < kLinks; ++i) {
      Vector8 noise;
      for (int k = 0; k < 8; ++k) noise(k) = random.gaussian(1.0);
      noise = root * noise;
      UncertainHomography sample;
      sample.homography = link.homography;
      for (int k = 0; k < 8; ++k) sample.homography(k / 3, k % 3) += noise(k);
      product = chained(sample, product);
    }
    Vector8 error;
    for (int k = 0; k < 8; ++k) {
      error(k) = product.homography(k / 3, k % 3) - expected.homography(k / 3, k % 3);
    }
    spread += error * error.transpose() / kTrials;
  }
  // Standard deviations of a sample of 20 000 are known to 0.5 %, correlations to 0.007.
  for (int i = 0; i < 8; ++i) {
    EXPECT_NEAR(std::sqrt(expected.covariance(i, i) / spread(i, i)), 1.0, 0.03) << i;
    for (int j = 0; j < 8; ++j) {
      const double scale = std::sqrt(spread(i, i) * spread(j, j));
      EXPECT_NEAR(expected.covariance(i, j) / scale, spread(i, j) / scale, 0.05) << i << ' ' << j;
    }
  }
}

TEST(MotionPredictor, CarriesTheMotionOnForTheTimeToTheNextFrame) {
  const auto predicted = [](std::int64_t from, std::int64_t to, std::int64_t next_stamp) {
    Frame reference, frame, next;
    reference.stamp = from;
    frame.stamp = to;
    next.stamp = next_stamp;
    MatchResult result;
    result.status = Status::ok;
    result.answer.homography = test::translation(2.0, 1.0);
    MotionPredictor predictor;
    predictor.restartAt(reference);
    predictor.advance(frame, reference, result);
    return predictor.predict(frame, next).value_or(Eigen::Matrix3d::Zero());
  };
  expectTranslation(predicted(0, 100, 200), 2.0, 1.0, 1e-9);
  expectTranslation(predicted(0, 100, 150), 1.0, 0.5, 1e-9);
  expectTranslation(predicted(0, 100, 5000), 6.0, 3.0, 1e-9);  // at most three times
  expectTranslation(predicted(0, 100, 90), 0.0, 0.0, 1e-9);
  // Without a clock the next motion equals the last one.
  expectTranslation(predicted(7, 7, 7), 2.0, 1.0, 1e-9);
  expectTranslation(predicted(7, 7, 8), 2.0, 1.0, 1e-9);
}

TEST(HomographyChain, UnknownCovarianceStaysUnknown) {
  const UncertainHomography exact{Eigen::Matrix3d::Identity()};
  UncertainHomography unknown{Eigen::Matrix3d::Identity()};
  unknown.covariance.setConstant(std::numeric_limits<double>::quiet_NaN());
  EXPECT_TRUE(std::isnan(chained(exact, chained(unknown, exact)).covariance(0, 0)));
}

// The same smooth error in each homography: after n of them it is n times as large, while noise
// grows with the square root of n.
TEST(HomographyChain, SharedErrorsAddUpFromFrameToFrame) {
  UncertainHomography link{Eigen::Matrix3d::Identity()};
  link.covariance(2, 2) = link.covariance(5, 5) = 0.04 + 0.01;
  link.shared_covariance(2, 2) = link.shared_covariance(5, 5) = 0.01;
  UncertainHomography product{Eigen::Matrix3d::Identity()};
  for (int n = 1; n <= 30; ++n) {
    product = chained(link, product);
    EXPECT_NEAR(product.shared_covariance(2, 2), 0.01 * n * n, 1e-9) << n;
    EXPECT_NEAR(product.covariance(2, 2), 0.04 * n + 0.01 * n * n, 1e-9) << n;
  }
}

// For errors of any correlation the covariance of the product is never too small.
TEST(HomographyChain, SharedErrorsOfAnyKindAreCovered) {
  UncertainHomography first{Eigen::Matrix3d::Identity()}, second = first;
  first.shared_covariance(2, 2) = 4.0;
  second.shared_covariance(2, 2) = 1.0;
  second.shared_covariance(5, 5) = 9.0;
  first.covariance = first.shared_covariance;
  second.covariance = second.shared_covariance;
  const UncertainHomography product = chained(second, first);
  EXPECT_GE(product.covariance(2, 2), 9.0 - 1e-9);  // (2 + 1)²
  EXPECT_GE(product.covariance(5, 5), 9.0 - 1e-9);
}

TEST(SequenceMatcher, TheAccumulatedCovarianceGrowsWithTheChain) {
  SequenceMatcher matcher(sequenceOf(ReferenceMode::previous));
  double before = 0.0;
  for (int i = 0; i < 6; ++i) {
    const SequenceMatch& match = matcher.match(view(i), 0.1 * i);
    if (i == 0) continue;
    const double variance = match.accumulated->covariance(2, 2);  // variance of the x translation
    EXPECT_GT(variance, before);
    if (i == 1) {
      EXPECT_DOUBLE_EQ(variance, match.match.answer.covariance(2, 2));
    }
    before = variance;
  }
}

// The search near the predicted positions: the prediction, and when the whole image is searched
// instead.

constexpr double kRadius = 16.0;
constexpr int kStep = 30;  // px between frames: more than the radius, so the prediction is needed

SequenceOptions searching(double radius, ReferenceMode mode = ReferenceMode::previous) {
  return sequenceOf(mode, radius);
}

TEST(SequenceSearch, CarriesTheMotionOn) {
  SequenceMatcher near(searching(kRadius));
  SequenceMatcher whole(searching(0.0));
  for (int i = 0; i < 12; ++i) {
    const SequenceMatch& n = near.match(test::viewAt(kStep * i, 10 * i), 0.1 * i);
    const SequenceMatch& w = whole.match(test::viewAt(kStep * i, 10 * i), 0.1 * i);
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
  SequenceMatcher matcher(searching(kRadius));
  // After lost frames the camera has moved proportionally farther.
  const int frames[] = {0, 1, 2, 4, 5, 8, 9, 11, 12};
  for (const int i : frames) {
    const SequenceMatch& match = matcher.match(test::viewAt(kStep * i, 0), 0.05 * i);
    const bool known = i > 1;
    EXPECT_TRUE(!known || match.match.search == Search::near) << i;
  }
}

TEST(SequenceSearch, FallBackEqualsTheWholeSearch) {
  SequenceMatcher near(searching(kRadius));
  SequenceMatcher whole(searching(0.0));
  const int places[] = {0, 5, 10, 110, 115, 300, 240, 245};  // jumps
  std::uint64_t fall_backs = 0;
  for (int i = 0; i < 8; ++i) {
    const SequenceMatch& n = near.match(test::viewAt(places[i], 0), 0.1 * i);
    const SequenceMatch& w = whole.match(test::viewAt(places[i], 0), 0.1 * i);
    EXPECT_EQ(n.match.status, w.match.status) << i;
    if (n.match.search != Search::fell_back) continue;
    ++fall_backs;
    EXPECT_EQ(n.match.answer.homography, w.match.answer.homography) << i;
    EXPECT_EQ(n.match.inliers, w.match.inliers) << i;
    EXPECT_EQ(n.match.prosac.mask, w.match.prosac.mask) << i;
  }
  EXPECT_GE(fall_backs, 3u);  // the three jumps at least
  EXPECT_EQ(near.match(test::viewAt(250, 0), 0.8).fall_backs, fall_backs);
}

TEST(SequenceSearch, SearchesNearForKeyframesAndFixedFrames) {
  for (const ReferenceMode mode : {ReferenceMode::keyframe, ReferenceMode::fixed}) {
    SequenceMatcher matcher(searching(kRadius, mode));
    if (mode == ReferenceMode::fixed) matcher.fixNextFrame();
    std::uint64_t fall_backs = 0;
    for (int i = 0; i < 7; ++i) {  // up to 120 px from the reference
      const SequenceMatch& match = matcher.match(test::viewAt(20 * i, 0), 0.1 * i);
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
  SequenceMatcher matcher(searching(kRadius, ReferenceMode::fixed));
  matcher.fixNextFrame();
  matcher.match(test::viewAt(0, 0), 0.0);
  matcher.match(test::viewAt(5, 0), 0.1);
  EXPECT_NE(matcher.match(test::flatImage(test::kView, 128), 0.2).match.status, Status::ok);
  const SequenceMatch& match = matcher.match(test::viewAt(90, 0), 0.3);
  EXPECT_EQ(match.match.status, Status::ok);
  EXPECT_EQ(match.match.search, Search::whole);
}

TEST(SequenceSearch, KnowsNoMotionAfterAGapAndAReset) {
  SequenceMatcher matcher(searching(kRadius));
  for (int i = 0; i < 4; ++i) matcher.match(test::viewAt(kStep * i, 0), 0.1 * i);
  matcher.match(test::viewAt(0, 0), 10.0);
  EXPECT_EQ(matcher.match(test::viewAt(2, 0), 10.1).match.search, Search::near);  // not kStep away
  for (int i = 0; i < 4; ++i) matcher.match(test::viewAt(kStep * i, 0), 10.2 + 0.1 * i);
  matcher.reset();
  matcher.match(test::viewAt(0, 0), 10.6);
  EXPECT_EQ(matcher.match(test::viewAt(2, 0), 10.7).match.search, Search::near);
}

TEST(SequenceSearch, SameForAnyNumberOfThreads) {
  SequenceOptions two = searching(kRadius);
  two.orb.threads = two.matcher.knn.threads = 2;
  SequenceMatcher one(searching(kRadius));
  SequenceMatcher other(two);
  for (int i = 0; i < 8; ++i) {
    const SequenceMatch& a = one.match(test::viewAt(kStep * i, 0), 0.1 * i);
    const SequenceMatch& b = other.match(test::viewAt(kStep * i, 0), 0.1 * i);
    EXPECT_EQ(a.match.answer.homography, b.match.answer.homography);
    EXPECT_EQ(a.match.search, b.match.search);
  }
}

// For any references of the frames, the path gives the map from any frame to any other.

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

void expectPath(const Eigen::Matrix3d& actual, const Eigen::Matrix3d& expected) {
  EXPECT_LT(metrics::cornerError(actual, expected, {640, 480}), 0.25e-6);
}

TEST(FramePath, EqualsProductOfItsSteps) {
  FramePath path(100);
  EXPECT_FALSE(path.add(0, 0, std::nullopt));
  for (int i = 1; i < 50; ++i) EXPECT_TRUE(path.add(i, i - 1, between(i - 1, i)));
  expectPath(*path.between(3, 40), between(3, 40));
  expectPath(*path.between(40, 3), between(40, 3));
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
  expectPath(*keyframes.between(85, 89), between(85, 89));
  expectPath(*fixed.between(81, 88), between(81, 88));
  expectPath(*fixed.between(0, 88), between(0, 88));
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
  expectPath(*path.between(8, 9), between(8, 9));
  EXPECT_FALSE(path.add(10, 9, Eigen::Matrix3d::Zero())) << "no homography at all";
  EXPECT_FALSE(path.add(11, 10, Eigen::Matrix3d::Constant(std::nan(""))));
}

TEST(FramePath, DoesNotWearOutOnALongFlight) {
  FramePath path(5);
  const Eigen::Matrix3d step = between(0, 1);
  path.add(0, 0, std::nullopt);
  for (int i = 1; i < 200000; ++i) ASSERT_TRUE(path.add(i, i - 1, step));
  expectPath(*path.between(199997, 199999), step * step);
}

TEST(FramePath, HasAtLeastOneFrame) {
  EXPECT_THROW(FramePath(0), std::invalid_argument);
}

}  // namespace
}  // namespace ktgp_orb
