// Many flat targets known, few of them or none in view: time while they are followed, corners and
// poses with their covariance, and wrong ids in other scenes.
//   targets_following TARGETS FRAMES FRAMES_OF_OTHER_SCENES FIRST_OF_THEM
// The last one goes on where an earlier run has ended.
// Prints the tables of doc/targets.md.

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <opencv2/core/eigen.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "ktgp_orb/planar_pose.h"
#include "ktgp_orb/target_finder.h"
#include "target_scenes.h"

namespace ktgp_orb {
namespace {

using test::kFrame;
using test::percent;
using test::percentile;
using test::processorMilliseconds;
using test::World;
using Vector6 = Eigen::Matrix<double, 6, 1>;

constexpr std::size_t kShown = 5;
constexpr double kWidth = 0.3;  // of a target, m

/// Where each of the shown targets is: they move slowly, with a tilt below 45 degrees.
test::Placement placementOf(std::size_t shown, std::size_t frame, const cv::Size& target) {
  constexpr double kPixels = 165.0;  // of the longer side
  const double time = static_cast<double>(frame) / 30.0;
  const double phase = 1.3 * static_cast<double>(shown);
  test::Placement p;
  p.tilt = 0.38 + 0.36 * std::sin(0.9 * time + phase);
  p.axis = 0.5 * time + phase;
  p.turn = 0.4 * std::sin(0.7 * time + 2.0 * phase);
  p.zoom = kPixels / std::max(target.width, target.height) * (1.0 + 0.08 * std::sin(time + phase));
  p.middle = {110.0 + 210.0 * static_cast<double>(shown % 3), shown < 3 ? 120.0 : 360.0};
  p.middle += Eigen::Vector2d(12.0 * std::sin(1.1 * time + phase), 12.0 * std::cos(time + phase));
  return p;
}

Eigen::Matrix3d camera() {
  return test::cameraMatrix(600, 600);
}

/// Error of the found pose in units of its covariance, squared.
double normalisedError(const DetectedTarget& found, const Eigen::Matrix3d& truth) {
  const Covariance8 any = Covariance8::Identity();
  const auto right = planarPoses(truth, any, camera(), found.image_size, kWidth).poses;
  const auto pose = planarPoses(found.homography.homography, found.homography.covariance, camera(),
                                found.image_size, kWidth)
                        .poses;
  if (right.empty() || pose.empty()) return std::numeric_limits<double>::infinity();
  const Eigen::AngleAxisd turn(pose[0].target_to_camera.linear() *
                               right[0].target_to_camera.linear().transpose());
  Vector6 error;
  error.head<3>() =
      pose[0].target_to_camera.translation() - right[0].target_to_camera.translation();
  error.tail<3>() = turn.angle() * turn.axis();
  return error.dot(pose[0].covariance.inverse() * error);
}

struct Score {
  std::size_t shown = 0, found = 0, others = 0;
  test::CornerErrors corners;  // of followed targets
  std::size_t poses = 0, right_poses = 0;
  std::size_t frames_for_all = 1;
  std::vector<double> milliseconds;
};

void count(const DetectedTarget& found, const Eigen::Matrix3d& truth, Score& score) {
  constexpr double kBound = 22.458;  // chi-square, six degrees of freedom, 99.9 %
  ++score.found;
  score.corners.add(found, truth, found.image_size);
  ++score.poses;
  if (normalisedError(found, truth) < kBound) ++score.right_poses;
}

/// `noisy`: with other light, blur and noise.
void follow(const World& world, TargetFinder& finder, double search_ms, bool noisy,
            std::size_t frames) {
  constexpr std::size_t kPerScene = 60;
  Score score;
  finder.setSearch(search_ms, finder.options().smallest_side, 8);
  std::vector<std::size_t> shown(kShown);
  for (std::size_t f = 0; f < frames; ++f) {
    const std::size_t in_scene = f % kPerScene;
    test::Numbers numbers(70000 + f / kPerScene);
    const double first = numbers.uniform(0.0, static_cast<double>(world.targets.size()));
    for (std::size_t i = 0; i < kShown; ++i) {
      constexpr std::size_t kStep = 197;
      shown[i] = (static_cast<std::size_t>(first) + i * kStep) % world.targets.size();
    }
    if (in_scene == 0) finder.restart();
    cv::Mat frame;
    world.backgrounds[f / kPerScene % world.backgrounds.size()].convertTo(frame, CV_32F);
    std::vector<Eigen::Matrix3d> truths;
    for (std::size_t i = 0; i < kShown; ++i) {
      const cv::Mat& image = world.targets[shown[i]].images[0];
      truths.push_back(test::homographyOf(placementOf(i, f, image.size()), image.size()));
      test::place(image, truths.back(), frame);
    }
    cv::Mat image;
    cv::RNG rng(f + 1);
    noisy ? test::lit(frame, numbers, rng).copyTo(image) : frame.convertTo(image, CV_8U);
    const double start = processorMilliseconds();
    const TargetFrame& answer = finder.find(image);
    const double milliseconds = processorMilliseconds() - start;
    constexpr std::size_t kUntilFollowed = 10;
    if (in_scene < kUntilFollowed) continue;
    score.milliseconds.push_back(milliseconds);
    score.frames_for_all = std::max(score.frames_for_all, answer.frames_for_all);
    score.shown += kShown;
    for (const DetectedTarget& found : answer.detections) {
      if (found.status != Status::ok) continue;
      const auto which = std::find_if(shown.begin(), shown.end(), [&](std::size_t one) {
        return world.targets[one].id == found.id;
      });
      if (which == shown.end()) {
        ++score.others;
      } else if (found.age > 1) {
        count(found, truths[static_cast<std::size_t>(which - shown.begin())], score);
      }
    }
  }
  std::printf("| %.0f | %s | %.1f | %zu | %.1f | %.1f | %zu | %.3f | %.2f | %.1f |\n", search_ms,
              noisy ? "light, blur, noise" : "exact", percent(score.found, score.shown),
              score.others, percentile(score.milliseconds, 0.5),
              percentile(score.milliseconds, 0.95), score.frames_for_all,
              std::sqrt(score.corners.squares / std::max(1, score.corners.count)),
              score.corners.largest, percent(score.right_poses, score.poses));
  std::fflush(stdout);
}

/// Photographs without any target. The first background shows a magazine that is also a target.
std::vector<cv::Mat> otherScenes(const World& world) {
  std::vector<cv::Mat> scenes(world.backgrounds.begin() + 1,
                              world.backgrounds.begin() + test::kBackgrounds);
  const char* folder = std::getenv("KTGP_ORB_DATA");
  for (const char* name : {"notredame/img1.png", "notredame/img2.png", "notredame/img3.png",
                           "notredame/img4.png", "notredame/img5.png", "notredame/img6.png",
                           "homogr/ExtremeZoomA.png", "homogr/ExtremeZoomB.png"}) {
    const cv::Mat image = cv::imread(std::string(folder == nullptr ? "" : folder) + "/hard/" + name,
                                     cv::IMREAD_GRAYSCALE);
    if (!image.empty()) scenes.push_back(image);
  }
  return scenes;
}

/// A part of one of the scenes, seen from anywhere; each fourth one is drawn, like the targets.
cv::Mat otherScene(const std::vector<cv::Mat>& scenes, std::size_t number) {
  test::Numbers numbers(900000 + number);
  cv::RNG rng(number + 1);
  cv::Mat scene, frame;
  if (number % 4 == 0) {
    scene = test::drawnPicture(cv::Size(700, 560), 2000000 + number);
  } else {
    const auto which =
        static_cast<std::size_t>(numbers.uniform(0.0, static_cast<double>(scenes.size())));
    scene = scenes[which];
  }
  test::Placement p;
  p.tilt = numbers.uniform(0.0, M_PI / 3.0);
  p.axis = numbers.uniform(0.0, 2.0 * M_PI);
  p.turn = numbers.uniform(-M_PI, M_PI);
  p.zoom = std::exp(numbers.uniform(-0.4, 1.1)) * 640.0 / scene.cols;
  p.middle = {numbers.uniform(200.0, 440.0), numbers.uniform(150.0, 330.0)};
  const Eigen::Matrix3d h = test::homographyOf(p, scene.size());
  cv::Mat map;
  cv::eigen2cv(h, map);
  cv::warpPerspective(scene, frame, map, kFrame, cv::INTER_LINEAR, cv::BORDER_REFLECT);
  frame.convertTo(frame, CV_32F);
  return test::lit(frame, numbers, rng);
}

void searchElsewhere(const World& world, TargetFinder& finder, std::size_t frames,
                     std::size_t first) {
  const std::vector<cv::Mat> scenes = otherScenes(world);
  finder.setSearch(std::numeric_limits<double>::infinity(), finder.options().smallest_side, 8);
  std::size_t wrong = 0, wrong_frames = 0, tried = 0;
  for (std::size_t f = first; f < first + frames; ++f) {
    finder.restart();
    const TargetFrame& answer = finder.find(otherScene(scenes, f));
    tried += answer.tried;
    for (const DetectedTarget& found : answer.detections) {
      if (found.status != Status::ok) continue;
      ++wrong;
      std::printf("frame %zu: %s, %zu inliers, %.1f\n", f, found.id.c_str(), found.inliers,
                  found.log_false_alarms);
    }
    wrong_frames += answer.detections.empty() ? 0 : 1;
  }
  std::printf(
      "%zu frames of %zu other scenes and of drawn ones, %.1f targets tried per frame: %zu wrong "
      "ids in %zu frames\n",
      frames, scenes.size(), static_cast<double>(tried) / static_cast<double>(frames), wrong,
      wrong_frames);
  if (wrong == 0) {
    std::printf("95 %% confidence: below %.0f in 10^5 frames\n", 3e5 / static_cast<double>(frames));
  }
}

}  // namespace
}  // namespace ktgp_orb

int main(int argc, char** argv) {
  using namespace ktgp_orb;
  cv::setNumThreads(1);
  const auto number = [&](int i, std::size_t otherwise) {
    return argc > i ? std::strtoul(argv[i], nullptr, 10) : otherwise;
  };
  World world = test::makeWorld(number(1, 1000));
  TargetFinder finder;
  test::addAll(world, finder);
  std::printf(
      "| search_ms | rendering | followed %% | wrong ids | ms, median | ms, 95 %% | frames for all "
      "| corners, RMS px | largest px | poses within 99.9 %% |\n|---|---|---|---|---|---|---|---|"
      "---|---|\n");
  const std::size_t frames = number(2, 600);
  for (const double search_ms : {20.0, 4.0}) follow(world, finder, search_ms, false, frames);
  follow(world, finder, 20.0, true, frames);
  searchElsewhere(world, finder, number(3, 5000), number(4, 0));
  return 0;
}
