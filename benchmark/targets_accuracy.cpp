// Many flat targets at once: recall, wrong ids, time and memory, beside SIFT with FLANN and
// cv::findHomography for each target.
//   targets_accuracy FRAMES FRAMES_OF_PEER TARGETS...
// Targets: parts of the photographs in KTGP_ORB_DATA, and drawn pictures. Prints the table of
// doc/targets.md.

#include <Eigen/Core>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>
#include <opencv2/features2d.hpp>

#include "core/homography/transform.h"
#include "ktgp_orb/target_finder.h"
#include "target_scenes.h"

namespace ktgp_orb {
namespace {

using test::kFrame;
using test::makeView;
using test::memoryInMegabytes;
using test::percent;
using test::percentile;
using test::processorMilliseconds;
using test::Truth;
using test::View;
using test::World;

/// A found target, by whatever method.
struct Answer {
  std::string id;
  Eigen::Matrix3d homography;
};

struct Score {
  std::size_t shown = 0;
  std::size_t found = 0;
  std::size_t shown_below_45 = 0;  // degrees of tilt
  std::size_t found_below_45 = 0;
  std::size_t wrong = 0;       // not in the frame
  std::size_t inaccurate = 0;  // in the frame, but elsewhere
  std::vector<double> milliseconds;
  std::vector<double> errors;  // px
};

constexpr double kRight = 15.0;  // px
constexpr double kNotMeasured = std::numeric_limits<double>::quiet_NaN();

double errorOf(const World& world, const Truth& truth, const Answer& answer) {
  return test::errorInView(truth.homography, answer.homography,
                           world.targets[truth.target].images[0].size(), kFrame);
}

void count(const World& world, const View& view, const std::vector<Answer>& answers, Score& score) {
  for (const Truth& truth : view.truths) {
    bool is_found = false;
    for (const Answer& answer : answers) {
      if (answer.id != world.targets[truth.target].id) continue;
      const double error = errorOf(world, truth, answer);
      if (error >= kRight) continue;
      score.errors.push_back(error);
      is_found = true;
    }
    ++score.shown;
    score.found += is_found ? 1 : 0;
    if (truth.tilt >= 45.0) continue;
    ++score.shown_below_45;
    score.found_below_45 += is_found ? 1 : 0;
  }
  for (const Answer& answer : answers) {
    bool is_shown = false;
    bool is_right = false;
    for (const Truth& truth : view.truths) {
      if (answer.id != world.targets[truth.target].id) continue;
      is_shown = true;
      is_right |= errorOf(world, truth, answer) < kRight;
    }
    if (!is_shown) {
      ++score.wrong;
    } else if (!is_right) {
      ++score.inaccurate;
    }
  }
}

void print(const char* method, std::size_t targets, const Score& score, double frames_to_first,
           double megabytes) {
  std::printf("| %s | %zu | %zu | %.1f | %.1f | %zu | %zu | %.2f | %.0f | %.0f | %.0f |\n", method,
              targets, score.shown, percent(score.found, score.shown),
              percent(score.found_below_45, score.shown_below_45), score.wrong, score.inaccurate,
              percentile(score.errors, 0.5), percentile(score.milliseconds, 0.5), frames_to_first,
              megabytes);
  std::fflush(stdout);
}

std::vector<Answer> answersOf(const TargetFrame& frame) {
  std::vector<Answer> answers;
  for (const DetectedTarget& target : frame.detections) {
    if (target.status == Status::ok) answers.push_back({target.id, target.homography.homography});
  }
  return answers;
}

/// Until one of the targets in the view is found, with a budget of 20 ms.
double framesToFirst(const World& world, const View& view, TargetFinder& finder) {
  constexpr int kMost = 60;
  finder.setSearch(20.0, finder.options().smallest_side, 8);
  finder.restart();
  for (int number = 1; number <= kMost; ++number) {
    Score score;
    count(world, view, answersOf(finder.find(view.image)), score);
    if (score.found > 0) return number;
  }
  return kMost;
}

/// The view as a camera of fewer pixels would take it; `answers` stay in px of the view.
std::vector<Answer> searchSmall(const View& view, double size, TargetFinder& finder) {
  cv::Mat small;
  cv::resize(view.image, small, cv::Size(), size, size, cv::INTER_AREA);
  std::vector<Answer> answers = answersOf(finder.find(small));
  const Eigen::Matrix3d to_view = homography::resizing(small.size(), view.image.size());
  for (Answer& answer : answers) answer.homography = to_view * answer.homography;
  return answers;
}

/// Wrong ids and wrong places in frames that are enlarged more than twice.
void measureSmall(World& world, std::size_t frames, double size) {
  TargetFinder finder;
  test::addAll(world, finder);
  Score score;
  for (std::size_t i = 0; i < frames; ++i) {
    const View view = makeView(world, 1000 + i);
    if (view.truths.empty()) continue;
    finder.restart();
    const double start = processorMilliseconds();
    const std::vector<Answer> answers = searchSmall(view, size, finder);
    score.milliseconds.push_back(processorMilliseconds() - start);
    count(world, view, answers, score);
  }
  const std::string name = "TargetFinder, " + std::to_string(cvRound(size * kFrame.width)) + " px";
  print(name.c_str(), world.targets.size(), score, kNotMeasured, kNotMeasured);
}

void measure(World& world, std::size_t frames) {
  const double before = memoryInMegabytes();
  TargetFinder finder;
  const double start_of_adding = processorMilliseconds();
  test::addAll(world, finder);
  std::printf("adding: %.1f s\n", 1e-3 * (processorMilliseconds() - start_of_adding));
  const double megabytes = memoryInMegabytes() - before;
  Score score;
  std::vector<double> to_first;
  for (std::size_t i = 0; i < frames; ++i) {
    const View view = makeView(world, 1000 + i);
    if (view.truths.empty()) continue;
    finder.restart();
    finder.setSearch(std::numeric_limits<double>::infinity(), finder.options().smallest_side, 8);
    const double start = processorMilliseconds();
    const TargetFrame& answer = finder.find(view.image);
    score.milliseconds.push_back(processorMilliseconds() - start);
    count(world, view, answersOf(answer), score);
    to_first.push_back(framesToFirst(world, view, finder));
  }
  print("TargetFinder", world.targets.size(), score, percentile(to_first, 0.5), megabytes);
}

/// The usual way: each target by itself.
void measurePeer(const World& world, std::size_t frames) {
  constexpr std::size_t kFewest = 12;  // inliers
  constexpr float kRatio = 0.7F;
  const double before = memoryInMegabytes();
  const auto sift_of_targets = cv::SIFT::create(500);
  const auto sift = cv::SIFT::create(3000);
  std::vector<std::vector<cv::KeyPoint>> keypoints(world.targets.size());
  std::vector<cv::Mat> descriptors(world.targets.size());
  for (std::size_t t = 0; t < world.targets.size(); ++t) {
    sift_of_targets->detectAndCompute(world.targets[t].images[0], {}, keypoints[t], descriptors[t]);
  }
  const double megabytes = memoryInMegabytes() - before;
  Score score;
  for (std::size_t i = 0; i < frames; ++i) {
    const View view = makeView(world, 1000 + i);
    if (view.truths.empty()) continue;
    const double start = processorMilliseconds();
    std::vector<cv::KeyPoint> frame;
    cv::Mat of_frame;
    sift->detectAndCompute(view.image, {}, frame, of_frame);
    cv::FlannBasedMatcher matcher;
    matcher.add(of_frame);
    matcher.train();
    std::vector<Answer> answers;
    for (std::size_t t = 0; t < world.targets.size(); ++t) {
      std::vector<std::vector<cv::DMatch>> pairs;
      if (descriptors[t].rows > 1) matcher.knnMatch(descriptors[t], pairs, 2);
      std::vector<cv::Point2f> from, to;
      for (const auto& pair : pairs) {
        if (pair.size() < 2 || pair[0].distance > kRatio * pair[1].distance) continue;
        from.push_back(keypoints[t][static_cast<std::size_t>(pair[0].queryIdx)].pt);
        to.push_back(frame[static_cast<std::size_t>(pair[0].trainIdx)].pt);
      }
      if (from.size() < kFewest) continue;
      cv::Mat mask;
      const cv::Mat h = cv::findHomography(from, to, cv::RANSAC, 3.0, mask);
      if (h.empty() || static_cast<std::size_t>(cv::countNonZero(mask)) < kFewest) continue;
      Eigen::Matrix3d homography;
      cv::cv2eigen(h, homography);
      answers.push_back({world.targets[t].id, homography});
    }
    score.milliseconds.push_back(processorMilliseconds() - start);
    count(world, view, answers, score);
  }
  print("SIFT, FLANN, findHomography", world.targets.size(), score, 1.0, megabytes);
}

}  // namespace
}  // namespace ktgp_orb

int main(int argc, char** argv) {
  cv::setNumThreads(1);
  const std::size_t frames = argc > 1 ? std::strtoul(argv[1], nullptr, 10) : 300;
  const std::size_t of_peer = argc > 2 ? std::strtoul(argv[2], nullptr, 10) : 30;
  std::printf(
      "| method | targets | shown | recall %% | below 45 degrees | wrong ids | inaccurate | error, "
      "median px | ms, median | frames to the first | MB "
      "|\n|---|---|---|---|---|---|---|---|---|---|"
      "---|\n");
  for (int i = 3; i < argc; ++i) {
    auto world = ktgp_orb::test::makeWorld(std::strtoul(argv[i], nullptr, 10));
    ktgp_orb::measure(world, frames);
    for (const double size : {0.5, 0.25}) ktgp_orb::measureSmall(world, frames, size);
    if (of_peer > 0) ktgp_orb::measurePeer(world, of_peer);
  }
  return 0;
}
