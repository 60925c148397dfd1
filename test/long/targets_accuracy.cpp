// Many flat targets at once: recall, wrong ids, time and memory, beside SIFT with FLANN and
// cv::findHomography for each target. Run by `ctest -L long`.
//   targets_accuracy FRAMES FRAMES_OF_PEER TARGETS...
// Targets: parts of the photographs in KTGP_ORB_DATA, and drawn pictures. Prints the table of
// doc/targets.md.

#include <time.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgcodecs.hpp>

#include "ktgp_orb/target_finder.h"
#include "target_world.h"

namespace ktgp_orb {
namespace {

constexpr double kWide = 120.0;  // px
const cv::Size kFrame(640, 480);
constexpr std::size_t kBackgrounds = 5;

/// Of this process, which other programs do not slow down.
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

/// The photographs, one of each scene.
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
        if (features.size() > 250) tiles.push_back(part);  // a picture with details
      }
    }
  }
  for (int i = 0; i < 20; ++i) {
    world.backgrounds.push_back(test::drawnPicture(kFrame, 900000U + static_cast<unsigned>(i)));
  }
  // Spread over the photographs, half of the targets if there are enough.
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

/// One to three targets, apart from each other.
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
    double left = 1e9, top = 1e9, right = -1e9, bottom = -1e9;
    for (const Eigen::Vector2d& c : test::corners(size)) {
      const Eigen::Vector2d q = (h * c.homogeneous()).hnormalized();
      left = std::min(left, q.x());
      right = std::max(right, q.x());
      top = std::min(top, q.y());
      bottom = std::max(bottom, q.y());
    }
    // At least so wide in either direction of the target... and mostly in view when it is small.
    const auto corners = test::corners(size);
    const auto at = [&](const Eigen::Vector2d& c) {
      return Eigen::Vector2d((h * c.homogeneous()).hnormalized());
    };
    const double width =
        0.5 * ((at(corners[1]) - at(corners[0])).norm() + (at(corners[2]) - at(corners[3])).norm());
    if (width < kWide) continue;
    const cv::Rect2d box(left, top, right - left, bottom - top);
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

double percentile(std::vector<double> values, double share) {
  if (values.empty()) return 0.0;
  const auto place = static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + place, values.end());
  return values[static_cast<std::size_t>(place)];
}

double percent(std::size_t part, std::size_t all) {
  return all == 0 ? 0.0 : 100.0 * static_cast<double>(part) / static_cast<double>(all);
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
  finder.setSearch(20.0, 48.0);
  finder.restart();
  for (int number = 1; number <= kMost; ++number) {
    Score score;
    count(world, view, answersOf(finder.find(view.image)), score);
    if (score.found > 0) return number;
  }
  return kMost;
}

void measure(const World& world, std::size_t frames) {
  const double before = memoryInMegabytes();
  TargetFinder finder;
  for (const Target& target : world.targets) {
    try {
      finder.add(target);
    } catch (const std::invalid_argument& error) {
      std::printf("refused: %s\n", error.what());
    }
  }
  const double megabytes = memoryInMegabytes() - before;
  Score score;
  std::vector<double> to_first;
  for (std::size_t i = 0; i < frames; ++i) {
    const View view = makeView(world, 1000 + i);
    if (view.truths.empty()) continue;
    finder.restart();
    finder.setSearch(std::numeric_limits<double>::infinity(), 48.0);
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
      const cv::Matx33d m(h);
      Eigen::Matrix3d homography;
      homography << m(0, 0), m(0, 1), m(0, 2), m(1, 0), m(1, 1), m(1, 2), m(2, 0), m(2, 1), m(2, 2);
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
    const auto world = ktgp_orb::makeWorld(std::strtoul(argv[i], nullptr, 10));
    ktgp_orb::measure(world, frames);
    if (of_peer > 0) ktgp_orb::measurePeer(world, of_peer);
  }
  return 0;
}
