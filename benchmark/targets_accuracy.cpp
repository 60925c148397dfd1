// Searches for many flat targets, compared with SIFT, FLANN and cv::findHomography for each target.
// Prints the tables of doc/targets.md. Targets are parts of the photographs in KTGP_ORB_DATA, and
// drawn pictures.
//   targets_accuracy recall FRAMES FRAMES_OF_PEER TARGETS...
// measures recall, wrong ids, time and memory.
//   targets_accuracy following TARGETS FRAMES FRAMES_OF_OTHER_SCENES FIRST_OF_THEM
// has few targets or none in view. It measures the time while they are followed, corners and poses
// with their covariance, and wrong ids in other scenes. The last number continues an earlier run.

#include <time.h>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <opencv2/core/eigen.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "homography/transform.h"
#include "ktgp_orb/orb_extractor.h"
#include "ktgp_orb/planar_pose.h"
#include "ktgp_orb/target_finder.h"
#include "target_world.h"

namespace ktgp_orb {
namespace {

using Vector6 = Eigen::Matrix<double, 6, 1>;

constexpr double kWide = 120.0;  // px
const cv::Size kFrame(640, 480);
constexpr std::size_t kBackgrounds = 5;

/// Processor time of this process, which other programs do not slow down.
double processorMilliseconds() {
  timespec time{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return 1e3 * static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_nsec);
}

double memoryInMegabytes() {
  std::ifstream file("/proc/self/statm");
  double size = 0.0;
  double resident = 0.0;
  file >> size >> resident;
  return resident * 4096.0 / 1e6;
}

/// The photographs: one of each scene.
std::vector<cv::Mat> photographs() {
  std::vector<cv::Mat> images;
  const char* folder = std::getenv("KTGP_ORB_DATA");
  if (folder == nullptr) return images;
  const std::string root(folder);
  for (const char* name :
       {"/oxford/boat/img1", "/oxford/bikes/img1", "/oxford/leuven/img1", "/hard/dogman/1",
        "/hard/homogr/LePoint1A", "/hard/homogr/EiffelA", "/hard/homogr/BruggeTowerA",
        "/hard/homogr/BostonLibA", "/hard/homogr/WhiteBoardA", "/hard/evd/1/mag",
        "/hard/evd/1/cafe", "/hard/evd/1/girl", "/hard/evd/1/adam", "/hard/evd/1/there"}) {
    for (const char* ending : {".pgm", ".ppm", ".png", ".jpg"}) {
      if (!std::filesystem::exists(root + name + ending)) continue;
      images.push_back(cv::imread(root + name + ending, cv::IMREAD_GRAYSCALE));
    }
  }
  return images;
}

struct World {
  std::vector<Target> targets;
  std::vector<cv::Mat> backgrounds;
};

/// The last photographs are backgrounds, without any target.
World makeWorld(std::size_t count) {
  World world;
  const cv::Size tile(300, 225);
  OrbOptions few;
  few.max_features = 400;
  OrbExtractor extractor(few);
  Features features;
  std::vector<cv::Mat> tiles;
  const std::vector<cv::Mat> all = photographs();
  for (std::size_t p = 0; p < all.size(); ++p) {
    const cv::Mat& photo = all[p];
    if (p + kBackgrounds >= all.size()) {
      cv::Mat background;
      cv::resize(photo, background, kFrame, 0, 0, cv::INTER_AREA);
      world.backgrounds.push_back(background);
      continue;
    }
    for (int y = 0; y + tile.height <= photo.rows; y += tile.height) {
      for (int x = 0; x + tile.width <= photo.cols; x += tile.width) {
        const cv::Mat part = photo(cv::Rect(cv::Point(x, y), tile)).clone();
        extractor.extract(part, features);
        if (features.size() > 250) tiles.push_back(part);  // keeps only pictures with details
      }
    }
  }
  for (int i = 0; i < 20; ++i) {
    world.backgrounds.push_back(test::drawnPicture(kFrame, 900000U + static_cast<unsigned>(i)));
  }
  // Half of the targets are parts of the photographs, spread evenly, if there are enough.
  const std::size_t photos = std::min(tiles.size(), count / 2);
  for (std::size_t i = 0; i < count; ++i) {
    Target target;
    target.id = "t" + std::to_string(i);
    const cv::Size size = i % 2 == 0 ? cv::Size(360, 270) : cv::Size(270, 380);
    target.images = {i < photos ? tiles[i * tiles.size() / std::max<std::size_t>(photos, 1)].clone()
                                : test::drawnPicture(size, i)};
    world.targets.push_back(target);
  }
  return world;
}

/// Adds the targets. A target that shows the same as another target is refused and left out.
void addAll(World& world, TargetFinder& finder) {
  std::vector<Target> added;
  for (const Target& target : world.targets) {
    try {
      finder.add(target);
      added.push_back(target);
    } catch (const std::invalid_argument& error) {
      std::printf("refused: %s\n", error.what());
    }
  }
  world.targets = std::move(added);
}

struct Truth {
  std::size_t target;
  Eigen::Matrix3d homography;
  double tilt, zoom;  // degrees, factor
};

struct View {
  cv::Mat image;
  std::vector<Truth> truths;
};

cv::Mat lit(cv::Mat frame, test::Numbers& numbers, cv::RNG& rng) {
  const double gain = numbers.uniform(0.6, 1.25);
  const double gamma = std::exp(numbers.uniform(-0.3, 0.3));
  const double blur = numbers.uniform(0.0, 0.8);
  if (blur > 0.3) cv::GaussianBlur(frame, frame, cv::Size(), blur);
  frame = cv::max(frame, 0.0) / 255.0;
  cv::pow(frame, gamma, frame);
  cv::Mat noise(frame.size(), CV_32F);
  rng.fill(noise, cv::RNG::NORMAL, 0.0, 3.0);
  cv::Mat image;
  cv::Mat(255.0 * gain * frame + noise).convertTo(image, CV_8U);
  return image;
}

/// Draws one to three targets, apart from each other.
View makeView(const World& world, std::uint64_t seed) {
  test::Numbers numbers(seed);
  cv::RNG rng(seed + 1);
  View view;
  cv::Mat frame;
  world.backgrounds[seed % world.backgrounds.size()].convertTo(frame, CV_32F);
  const int wanted = 1 + static_cast<int>(numbers.uniform(0.0, 3.0));
  std::vector<cv::Rect2d> boxes;
  for (int tries = 0; tries < 60 && static_cast<int>(boxes.size()) < wanted; ++tries) {
    const auto t =
        static_cast<std::size_t>(numbers.uniform(0.0, static_cast<double>(world.targets.size())));
    const cv::Size size = world.targets[t].images[0].size();
    test::Placement p;
    p.tilt = numbers.uniform(0.0, M_PI / 3.0);
    p.axis = numbers.uniform(0.0, 2.0 * M_PI);
    p.turn = numbers.uniform(-M_PI, M_PI);
    p.zoom = std::exp(numbers.uniform(-std::log(3.0), std::log(3.0)));
    p.middle = {numbers.uniform(100.0, 540.0), numbers.uniform(80.0, 400.0)};
    const Eigen::Matrix3d h = test::homographyOf(p, size);
    Eigen::Matrix<double, 2, 4> outline;
    for (int i = 0; i < 4; ++i) {
      outline.col(i) = test::apply(h, test::corners(size)[static_cast<std::size_t>(i)]);
    }
    // A target must be at least kWide, and mostly in view if it is small.
    const double width =
        0.5 * ((outline.col(1) - outline.col(0)).norm() + (outline.col(2) - outline.col(3)).norm());
    if (width < kWide) continue;
    const Eigen::Vector2d low = outline.rowwise().minCoeff();
    const Eigen::Vector2d extent = outline.rowwise().maxCoeff() - low;
    const cv::Rect2d box(low.x(), low.y(), extent.x(), extent.y());
    const cv::Rect2d seen = box & cv::Rect2d(0, 0, kFrame.width, kFrame.height);
    const bool fits = seen.area() > 0.95 * box.area();
    const bool fills = p.zoom > 1.2 && seen.area() > 0.6 * kFrame.area();
    if (!fits && !fills) continue;
    const bool meets = std::any_of(boxes.begin(), boxes.end(), [&](const cv::Rect2d& other) {
      return (other & box).area() > 0.0;
    });
    const bool known = std::any_of(view.truths.begin(), view.truths.end(),
                                   [&](const Truth& other) { return other.target == t; });
    if (meets || known) continue;
    boxes.push_back(box);
    test::place(world.targets[t].images[0], h, frame);
    view.truths.push_back({t, h, p.tilt * 180.0 / M_PI, p.zoom});
  }
  view.image = lit(frame, numbers, rng);
  return view;
}

double percentile(std::vector<double> values, double share) {
  if (values.empty()) return 0.0;
  const auto place = static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + place, values.end());
  return values[static_cast<std::size_t>(place)];
}

double percent(std::size_t part, std::size_t all) {
  return all == 0 ? 0.0 : 100.0 * static_cast<double>(part) / static_cast<double>(all);
}

/// A target found by any method.
struct Answer {
  std::string id;
  Eigen::Matrix3d homography;
};

struct Score {
  std::size_t shown = 0;
  std::size_t found = 0;
  std::size_t shown_below_45 = 0;  // degrees of tilt
  std::size_t found_below_45 = 0;
  std::size_t wrong = 0;       // answers with a target that is not in the frame
  std::size_t inaccurate = 0;  // answers at a wrong place
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

/// Number of frames until one of the targets in the view is found, with a budget of 20 ms.
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

/// Searches the view as seen by a camera with fewer pixels. The answers are in px of the view.
std::vector<Answer> searchSmall(const View& view, double size, TargetFinder& finder) {
  cv::Mat small;
  cv::resize(view.image, small, cv::Size(), size, size, cv::INTER_AREA);
  std::vector<Answer> answers = answersOf(finder.find(small));
  const Eigen::Matrix3d to_view = homography::resizing(small.size(), view.image.size());
  for (Answer& answer : answers) answer.homography = to_view * answer.homography;
  return answers;
}

/// Visits the frames that show a target, among the first `frames`.
template <typename Visit>
void forEachView(const World& world, std::size_t frames, Visit visit) {
  for (std::size_t i = 0; i < frames; ++i) {
    const View view = makeView(world, 1000 + i);
    if (!view.truths.empty()) visit(view);
  }
}

/// Counts what `search` returns for the view, and its time.
template <typename Search>
void rate(const World& world, const View& view, Score& score, Search search) {
  const double start = processorMilliseconds();
  const std::vector<Answer> answers = search();
  score.milliseconds.push_back(processorMilliseconds() - start);
  count(world, view, answers, score);
}

/// Measures wrong ids and wrong places in frames that are enlarged more than twice.
void measureSmall(World& world, std::size_t frames, double size) {
  TargetFinder finder;
  addAll(world, finder);
  Score score;
  forEachView(world, frames, [&](const View& view) {
    finder.restart();
    rate(world, view, score, [&] { return searchSmall(view, size, finder); });
  });
  const std::string name = "TargetFinder, " + std::to_string(cvRound(size * kFrame.width)) + " px";
  print(name.c_str(), world.targets.size(), score, kNotMeasured, kNotMeasured);
}

void measure(World& world, std::size_t frames) {
  const double before = memoryInMegabytes();
  TargetFinder finder;
  const double start_of_adding = processorMilliseconds();
  addAll(world, finder);
  std::printf("adding: %.1f s\n", 1e-3 * (processorMilliseconds() - start_of_adding));
  const double megabytes = memoryInMegabytes() - before;
  Score score;
  std::vector<double> to_first;
  forEachView(world, frames, [&](const View& view) {
    finder.restart();
    finder.setSearch(std::numeric_limits<double>::infinity(), finder.options().smallest_side, 8);
    rate(world, view, score, [&] { return answersOf(finder.find(view.image)); });
    to_first.push_back(framesToFirst(world, view, finder));
  });
  print("TargetFinder", world.targets.size(), score, percentile(to_first, 0.5), megabytes);
}

/// Measures the usual way, which searches for each target by itself.
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
  const auto search = [&](const View& view) {
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
    return answers;
  };
  Score score;
  forEachView(world, frames,
              [&](const View& view) { rate(world, view, score, [&] { return search(view); }); });
  print("SIFT, FLANN, findHomography", world.targets.size(), score, 1.0, megabytes);
}

constexpr std::size_t kShown = 5;
constexpr double kWidth = 0.3;  // width of a target, m

/// Placement of each shown target. The targets move slowly, with a tilt below 45 degrees.
test::Placement placementOf(std::size_t shown, std::size_t frame, const cv::Size& target) {
  constexpr double kPixels = 165.0;  // longer side of a target, px
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

/// Squared error of the found pose in units of its covariance.
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

struct Followed {
  std::size_t shown = 0, found = 0, others = 0;
  test::CornerErrors corners;  // errors of followed targets
  std::size_t poses = 0, right_poses = 0;
  std::size_t frames_for_all = 1;
  std::vector<double> milliseconds;
};

void count(const DetectedTarget& found, const Eigen::Matrix3d& truth, Followed& score) {
  constexpr double kBound = 22.458;  // chi-square, six degrees of freedom, 99.9 %
  ++score.found;
  score.corners.add(found, truth, found.image_size);
  ++score.poses;
  if (normalisedError(found, truth) < kBound) ++score.right_poses;
}

/// `noisy`: the frames have other light, blur and noise.
void follow(const World& world, TargetFinder& finder, double search_ms, bool noisy,
            std::size_t frames) {
  constexpr std::size_t kPerScene = 60;
  Followed score;
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
    noisy ? lit(frame, numbers, rng).copyTo(image) : frame.convertTo(image, CV_8U);
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
              percentile(score.milliseconds, 0.95), score.frames_for_all, score.corners.rms(),
              score.corners.largest, percent(score.right_poses, score.poses));
  std::fflush(stdout);
}

/// Photographs without any target. The first background shows a magazine that is also a target.
std::vector<cv::Mat> otherScenes(const World& world) {
  std::vector<cv::Mat> scenes(world.backgrounds.begin() + 1,
                              world.backgrounds.begin() + kBackgrounds);
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

/// A part of a scene, seen from anywhere. Every fourth scene is drawn, like the targets.
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
  return lit(frame, numbers, rng);
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

/// The arguments of the command line after the first.
using Numbers = std::vector<std::size_t>;

void recall(const Numbers& numbers) {
  std::printf(
      "| method | targets | shown | recall %% | below 45 degrees | wrong ids | inaccurate | error, "
      "median px | ms, median | frames to the first | MB "
      "|\n|---|---|---|---|---|---|---|---|---|---|"
      "---|\n");
  for (std::size_t i = 2; i < numbers.size(); ++i) {
    World world = makeWorld(numbers[i]);
    measure(world, numbers[0]);
    for (const double size : {0.5, 0.25}) measureSmall(world, numbers[0], size);
    if (numbers[1] > 0) measurePeer(world, numbers[1]);
  }
}

void following(const Numbers& numbers) {
  World world = makeWorld(numbers[0]);
  TargetFinder finder;
  addAll(world, finder);
  std::printf(
      "| search_ms | rendering | followed %% | wrong ids | ms, median | ms, 95 %% | frames for all "
      "| corners, RMS px | largest px | poses within 99.9 %% |\n|---|---|---|---|---|---|---|---|"
      "---|---|\n");
  for (const double search_ms : {20.0, 4.0}) follow(world, finder, search_ms, false, numbers[1]);
  follow(world, finder, 20.0, true, numbers[1]);
  searchElsewhere(world, finder, numbers[2], numbers[3]);
}

}  // namespace
}  // namespace ktgp_orb

int main(int argc, char** argv) {
  cv::setNumThreads(1);
  ktgp_orb::Numbers numbers;
  for (int i = 2; i < argc; ++i) numbers.push_back(std::strtoul(argv[i], nullptr, 10));
  const std::string table = argc > 1 ? argv[1] : "";
  if (table == "recall" && numbers.size() > 2) {
    ktgp_orb::recall(numbers);
  } else if (table == "following" && numbers.size() == 4) {
    ktgp_orb::following(numbers);
  } else {
    std::fprintf(stderr, "targets_accuracy recall|following NUMBERS: see the head of its source\n");
    return 2;
  }
  return 0;
}
