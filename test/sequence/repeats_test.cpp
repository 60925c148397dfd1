// Images that repeat the one before, as drivers and videos with a doubled rate have them, and
// cameras that stand still, whose images are alike, too.

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <random>
#include <vector>

#include "ktgp_orb/sequence_matcher.h"
#include "moving_view.h"
#include "orb_test_images.h"

namespace ktgp_orb {
namespace {

using test::sequenceOf;

constexpr double kRate = 60.0;  // images/s
constexpr int kStep = 4;        // px from one new image to the next

/// The view of the camera, with the noise of its sensor.
cv::Mat taken(double x, int number) {
  static const cv::Mat world = test::textureImage(cv::Size(1200, 600), 1);
  cv::Mat image;
  cv::getRectSubPix(world, test::kView, cv::Point2f(static_cast<float>(x) + 200.F, 200.F), image);
  std::mt19937 engine(static_cast<unsigned>(number));
  std::normal_distribution<double> noise(0.0, 1.5);
  for (int y = 0; y < image.rows; ++y) {
    for (int i = 0; i < image.cols; ++i) {
      auto& pixel = image.at<std::uint8_t>(y, i);
      pixel = cv::saturate_cast<std::uint8_t>(pixel + noise(engine));
    }
  }
  return image;
}

cv::Mat compressed(const cv::Mat& image, int quality) {
  std::vector<std::uint8_t> bytes;
  cv::imencode(".jpg", image, bytes, {cv::IMWRITE_JPEG_QUALITY, quality});
  return cv::imdecode(bytes, cv::IMREAD_GRAYSCALE);
}

/// What comes out of images that show the views of these numbers.
struct Outcome {
  int missed = 0;  // repetitions that were taken for new frames
  int false_ones = 0;
  double worst = 0.0;  // error of the way since the reference, px
};

Outcome outcomeOf(const std::vector<int>& numbers, ReferenceMode mode, bool compress) {
  SequenceMatcher matcher(sequenceOf(mode));
  Outcome outcome;
  std::vector<int> shown;  // of all stamps
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    cv::Mat image = taken(kStep * numbers[i], numbers[i]);
    if (compress) image = compressed(image, 85 + static_cast<int>(i * 7 % 11));
    shown.push_back(numbers[i]);
    const SequenceMatch& match = matcher.match(image, 1.0 + static_cast<double>(i) / kRate);
    const bool repeats = i > 0 && numbers[i] == numbers[i - 1];
    outcome.missed += repeats && !match.repeated ? 1 : 0;
    outcome.false_ones += !repeats && match.repeated ? 1 : 0;
    if (!match.reference || match.match.status != Status::ok) continue;
    const auto number = [&](const Frame& frame) {
      const double seconds = 1e-9 * static_cast<double>(frame.stamp) - 1.0;
      return shown.at(static_cast<std::size_t>(std::lround(kRate * seconds)));
    };
    const double way = kStep * (number(*match.frame) - number(*match.reference));
    outcome.worst = std::max(outcome.worst, std::abs(match.match.answer.homography(0, 2) + way));
  }
  return outcome;
}

std::vector<int> repeated(int images, const std::function<int(int)>& times) {
  std::vector<int> numbers;
  for (int i = 0; static_cast<int>(numbers.size()) < images; ++i) {
    for (int k = times(i); k > 0; --k) numbers.push_back(i);
  }
  return numbers;
}

TEST(Repeats, TheSamePixelsAreNoNewFrame) {
  const std::function<int(int)> patterns[] = {
      [](int) { return 2; }, [](int i) { return i == 0 ? 1 : 2; }, [](int) { return 3; },
      [](int i) { return 1 + i * i % 4; }, [](int i) { return i % 7 == 3 ? 2 : 1; }};
  for (const auto& times : patterns) {
    for (const ReferenceMode mode : {ReferenceMode::previous, ReferenceMode::keyframe}) {
      const Outcome outcome = outcomeOf(repeated(60, times), mode, false);
      EXPECT_EQ(outcome.missed, 0);
      EXPECT_EQ(outcome.false_ones, 0);
      EXPECT_LT(outcome.worst, 1.0);
    }
  }
}

// 1.25 images/s, each published twice: the time until the copy is longer than most cameras need for
// a new image.
TEST(Repeats, TheSamePixelsAtALowRateAreFoundByTheirAlternation) {
  SequenceMatcher matcher(sequenceOf(ReferenceMode::previous));
  int missed = 0;
  for (int i = 0; i < 60; ++i) {
    const SequenceMatch& match = matcher.match(test::viewAt(kStep * (i / 2), 20), 1.0 + 0.4 * i);
    missed += i % 2 == 1 && !match.repeated ? 1 : 0;
    EXPECT_FALSE(i % 2 == 0 && match.repeated) << i;
  }
  EXPECT_LE(missed, 3);
}

TEST(Repeats, ADoubledCameraThatStopsHasFramesSoonAgain) {
  for (const double period : {1.0 / kRate, 0.4}) {
    SequenceMatcher matcher(sequenceOf(ReferenceMode::previous));
    constexpr int kStops = 30;
    int repeats = 0;
    for (int i = 0; i < 50; ++i) {
      const int x = kStep * (std::min(i, kStops) / 2);
      const SequenceMatch& match = matcher.match(test::viewAt(x, 20), 1.0 + period * i);
      repeats += i > kStops && match.repeated ? 1 : 0;
    }
    EXPECT_LE(repeats, 4) << period;
  }
}

// Found by the pattern, which takes a few repetitions.
TEST(Repeats, ImagesThatWereCompressedAnewAreFoundSoon) {
  for (const int times : {2, 3}) {
    const Outcome outcome =
        outcomeOf(repeated(90, [=](int) { return times; }), ReferenceMode::previous, true);
    EXPECT_LE(outcome.missed, 8) << times;
    EXPECT_EQ(outcome.false_ones, 0) << times;
  }
}

TEST(Repeats, NoneInAMotionThatStopsShakesOrSlowsDown) {
  const std::function<double(double)> motions[] = {
      [](double t) { return 40.0 * t; },                            // 2/3 px an image
      [](double t) { return 30.0 + 30.0 * std::sin(9.0 * t); },     // turns
      [](double t) { return 200.0 * (1.0 - std::exp(-2.0 * t)); },  // slows down
      [](double t) { return 60.0 + 6.0 * std::sin(40.0 * t) + 30.0 * t; }};
  for (const auto& way : motions) {
    SequenceMatcher matcher(sequenceOf(ReferenceMode::previous));
    for (int i = 0; i < 100; ++i) {
      const double t = i / kRate;
      const cv::Mat image = compressed(taken(way(t), i), 90);
      EXPECT_FALSE(matcher.match(image, 1.0 + t).repeated) << i;
    }
  }
}

// A simulated camera has no noise.
TEST(Repeats, ACameraThatStandsStillHasFramesSoonAgain) {
  SequenceMatcher matcher(sequenceOf(ReferenceMode::previous));
  int repeats = 0;
  for (int i = 0; i < 60; ++i) {
    const bool moves = i >= 15 && i < 40;
    const int x = kStep * (i < 15 ? 0 : std::min(i, 40) - 15);
    const SequenceMatch& match = matcher.match(test::viewAt(x, 20), 1.0 + i / 30.0);
    repeats += match.repeated ? 1 : 0;
    EXPECT_FALSE(moves && match.repeated) << i;
  }
  EXPECT_LE(repeats, 6);
}

TEST(Repeats, TimesThatAreMissingOrEqualHideNoFrame) {
  SequenceMatcher matcher(sequenceOf(ReferenceMode::previous));
  for (int i = 0; i < 5; ++i) EXPECT_FALSE(matcher.match(test::viewAt(0, 20), 0.0).repeated);
  EXPECT_FALSE(matcher.match(test::viewAt(0, 20), 5.0).repeated);
  EXPECT_TRUE(matcher.match(test::viewAt(0, 20), 5.0).repeated) << "a message that came twice";
}

TEST(Repeats, OtherOptionsMatchTheSameImageAnew) {
  SequenceMatcher matcher(sequenceOf(ReferenceMode::previous));
  matcher.match(test::viewAt(0, 20), 1.0);
  EXPECT_TRUE(matcher.match(test::viewAt(0, 20), 1.01).repeated);
  matcher.setOptions(sequenceOf(ReferenceMode::keyframe));
  EXPECT_FALSE(matcher.match(test::viewAt(0, 20), 1.02).repeated);
  matcher.fixNextFrame();
  EXPECT_FALSE(matcher.match(test::viewAt(0, 20), 1.03).repeated);
  matcher.setFixedReference(nullptr);
  EXPECT_FALSE(matcher.match(test::viewAt(0, 20), 1.04).repeated);
  matcher.restart();
  EXPECT_FALSE(matcher.match(test::viewAt(0, 20), 1.05).repeated);
}

TEST(Repeats, ARefusedImageDoesNotMakeTheMatcherForgetItsNewOptions) {
  SequenceOptions options = sequenceOf(ReferenceMode::previous);
  SequenceMatcher matcher(options);
  matcher.match(test::viewAt(0, 20), 1.0);
  options.orb.max_features = 100;
  matcher.setOptions(options);
  EXPECT_THROW(matcher.match(cv::Mat(test::kView, CV_8UC3), 1.01), std::invalid_argument);
  const SequenceMatch& match = matcher.match(test::viewAt(0, 20), 1.02);
  EXPECT_FALSE(match.repeated);
  EXPECT_LE(match.frame->features.size(), 100U);
}

// A recording that is played in a loop, at a place where the camera stood still.
TEST(Repeats, TheSameImageWithAStampThatWentBackIsANewFrame) {
  SequenceMatcher matcher(sequenceOf(ReferenceMode::previous));
  for (const double start : {50.0, 10.0}) {
    for (int i = 0; i < 30; ++i) {
      const SequenceMatch& match = matcher.match(test::viewAt(0, 20), start + i / 30.0);
      EXPECT_FALSE(i == 0 && match.repeated);
      EXPECT_FALSE(i > 4 && match.repeated) << i;
      if (i > 5) {
        EXPECT_EQ(match.match.status, Status::ok) << start << " " << i;
      }
    }
  }
}

// One stamp of a driver is wrong: the frames around it stay connected.
TEST(SequenceMatcher, ASingleStampThatGoesBackBreaksNoChain) {
  for (const ReferenceMode mode : {ReferenceMode::previous, ReferenceMode::keyframe}) {
    for (const double wrong : {-5.0, -0.03, -1e-3}) {
      SequenceMatcher matcher(sequenceOf(mode));
      for (int i = 0; i < 12; ++i) {
        const bool is_wrong = i == 5 || i == 9;
        const double before = 10.0 + (i - 1) / 30.0;
        const double seconds = is_wrong ? before + wrong : 10.0 + i / 30.0;
        const SequenceMatch& match = matcher.match(taken(kStep * i, i), seconds);
        EXPECT_EQ(match.no_reference, i == 0     ? NoReference::first_frame
                                      : is_wrong ? NoReference::stamp_went_back
                                                 : NoReference::none)
            << i;
        EXPECT_EQ(match.accumulated.has_value(), i > 0 && !is_wrong) << i;
        if (match.accumulated) {
          test::expectTranslation(match.accumulated->homography, -kStep * i, 0.0, 1.0);
        }
      }
    }
  }
}

// Half a second is less than max_age, so the frame is matched; an hour is a gap.
TEST(SequenceMatcher, ASingleStampAheadBreaksNoChain) {
  for (const ReferenceMode mode : {ReferenceMode::previous, ReferenceMode::keyframe}) {
    for (const double wrong : {0.5, 3600.0}) {
      SequenceMatcher matcher(sequenceOf(mode));
      for (int i = 0; i < 16; ++i) {
        const bool is_wrong = i == 5 || i == 10;
        const double seconds = 10.0 + i / 30.0 + (is_wrong ? wrong : 0.0);
        const bool is_left_out = wrong < 1.0 ? i == 6 || i == 11 : is_wrong;
        const SequenceMatch& match = matcher.match(taken(kStep * i, i), seconds);
        EXPECT_EQ(match.accumulated.has_value(), i > 0 && !is_left_out) << i << ", " << wrong;
        if (match.accumulated) {
          test::expectTranslation(match.accumulated->homography, -kStep * i, 0.0, 1.0);
          EXPECT_EQ(match.first_stamp, 10'000'000'000) << i;
        }
      }
    }
  }
}

TEST(SequenceMatcher, ALoopedRecordingBeginsAnew) {
  SequenceMatcher matcher(sequenceOf(ReferenceMode::previous));
  for (int i = 0; i < 12; ++i) {
    const double seconds = i < 6 ? 20.0 + i / 30.0 : 10.0 + i / 30.0;
    const SequenceMatch& match = matcher.match(taken(kStep * i, i), seconds);
    EXPECT_EQ(match.match.status == Status::ok, i != 0 && i != 6) << i;
    if (i > 6) {
      EXPECT_EQ(match.first_stamp, 10'200'000'000) << i;
    }
  }
}

}  // namespace
}  // namespace ktgp_orb
