// Many flat targets at once: recall, wrong ids, time and memory, beside SIFT with FLANN and
// cv::findHomography for each target. Run by `ctest -L long`.
//   targets_accuracy FRAMES [PEER_FRAMES]
// Targets: parts of the photographs in KTGP_ORB_DATA, and drawn pictures. Prints the table of
// doc/targets.md.

#include <sys/resource.h>

#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <opencv2/calib3d.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgcodecs.hpp>

#include "ktgp_orb/target_finder.h"
#include "target_world.h"

namespace ktgp_orb {
namespace {

using Clock = std::chrono::steady_clock;
constexpr double kWide = 120.0;  // px
const cv::Size kFrame(640, 480);

double millisecondsSince(Clock::time_point start) {
  return std::chrono::duration<double, std::milli>(Clock::now() - start).count();
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

/// The photographs first; half of each photograph is a background.
World makeWorld(std::size_t count) {
  World world;
  const cv::Size tile(300, 225);
  OrbOptions few;
  few.max_features = 400;
  OrbExtractor extractor(few);
  Features features;
  std::vector<cv::Mat> tiles;
  for (const cv::Mat& photo : photographs()) {
    int number = 0;
    for (int y = 0; y + tile.height <= photo.rows; y += tile.height) {
      for (int x = 0; x + tile.width <= photo.cols; x += tile.width) {
        if (number++ % 4 == 3) continue;
        const cv::Mat part = photo(cv::Rect(cv::Point(x, y), tile)).clone();
        extractor.extract(part, features);
        if (features.size() > 250) tiles.push_back(part);  // a picture with details
      }
    }
    cv::Mat background;
    cv::resize(photo, background, kFrame, 0, 0, cv::INTER_AREA);
    cv::flip(background, background, 1);  // mirrored: no target is in it
    world.backgrounds.push_back(background);
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

struct Score {
  std::size_t shown = 0, found = 0, wrong = 0;
  std::map<std::string, std::pair<std::size_t, std::size_t>> by;
  std::vector<double> times, errors;
};

void count(const World& world, const View& view, const TargetFrame& answer, Score& score) {
  for (const Truth& truth : view.truths) {
    const cv::Size size = world.targets[truth.target].images[0].size();
    bool found = false;
    for (const DetectedTarget& d : answer.detections) {
      if (d.status != Status::ok || d.id != world.targets[truth.target].id) continue;
      const double error =
          test::errorInView(truth.homography, d.homography.homography, size, kFrame);
      if (error < 15.0) {
        found = true;
        score.errors.push_back(error);
      }
    }
    ++score.shown;
    score.found += found ? 1 : 0;
    const std::string tilt = "tilt " + std::to_string(static_cast<int>(truth.tilt / 15.0) * 15);
    const std::string zoom = truth.zoom < 0.5 ? "zoom <0.5"
                             : truth.zoom < 1 ? "zoom <1"
                                              : "zoom >1";
    for (const std::string& key :
         {tilt, zoom,
          std::string(world.targets[truth.target].images[0].cols == 300 ? "photo" : "drawn")}) {
      ++score.by[key].second;
      score.by[key].first += found ? 1 : 0;
    }
  }
  for (const DetectedTarget& d : answer.detections) {
    if (d.status != Status::ok) continue;
    const bool shown = std::any_of(view.truths.begin(), view.truths.end(), [&](const Truth& t) {
      return world.targets[t.target].id == d.id &&
             test::errorInView(t.homography, d.homography.homography,
                               world.targets[t.target].images[0].size(), kFrame) < 40.0;
    });
    if (!shown) {
      ++score.wrong;
      const bool inaccurate =
          std::any_of(view.truths.begin(), view.truths.end(),
                      [&](const Truth& t) { return world.targets[t.target].id == d.id; });
      std::printf("  %s: %s instance %d inliers %zu log %.1f\n",
                  inaccurate ? "inaccurate" : "wrong", d.id.c_str(), d.instance, d.inliers,
                  d.log_false_alarms);
    }
  }
}

double percentile(std::vector<double> values, double share) {
  if (values.empty()) return 0.0;
  const auto place = static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + place, values.end());
  return values[static_cast<std::size_t>(place)];
}

void measure(std::size_t count_of_targets, std::size_t frames, double search_ms) {
  const double before = memoryInMegabytes();
  World world = makeWorld(count_of_targets);
  const double with_images = memoryInMegabytes();
  TargetFinderOptions options;
  options.search_ms = search_ms;
  TargetFinder finder(options);
  const auto start = Clock::now();
  std::size_t refused = 0;
  for (const Target& target : world.targets) {
    try {
      finder.add(target);
    } catch (const std::invalid_argument& error) {
      if (++refused < 5) std::printf("  %s\n", error.what());
    }
  }
  const double added = millisecondsSince(start);
  const double memory = memoryInMegabytes() - with_images;
  Score score;
  double tried = 0.0, candidates = 0.0, extraction = 0.0;
  for (std::size_t i = 0; i < frames; ++i) {
    const View view = makeView(world, 1000 + i);
    finder.restart();
    const TargetFrame& answer = finder.find(view.image);
    score.times.push_back(answer.search.milliseconds);
    tried += static_cast<double>(answer.search.tried);
    candidates += static_cast<double>(answer.search.candidates);
    extraction += answer.search.extraction_milliseconds;
    count(world, view, answer, score);
  }
  const auto n = static_cast<double>(frames);
  std::printf(
      "%zu targets (%zu refused), %.0f MB (images %.0f), added in %.1f s: recall %.2f %% of %zu, "
      "wrong %zu, "
      "ms median %.1f p95 %.1f (extraction %.1f), candidates %.1f tried %.1f, corner error median "
      "%.3f p95 %.3f px\n",
      count_of_targets, refused, memory, with_images - before, added / 1000.0,
      100.0 * static_cast<double>(score.found) / static_cast<double>(score.shown), score.shown,
      score.wrong, percentile(score.times, 0.5), percentile(score.times, 0.95), extraction / n,
      candidates / n, tried / n, percentile(score.errors, 0.5), percentile(score.errors, 0.95));
  for (const auto& [key, value] : score.by) {
    std::printf("    %s: %.1f %% of %zu\n", key.c_str(),
                100.0 * static_cast<double>(value.first) / static_cast<double>(value.second),
                value.second);
  }
  std::fflush(stdout);
}

}  // namespace
}  // namespace ktgp_orb

int main(int argc, char** argv) {
  const std::size_t frames = argc > 1 ? std::strtoul(argv[1], nullptr, 10) : 300;
  for (int i = 2; i < argc; ++i) {
    ktgp_orb::measure(std::strtoul(argv[i], nullptr, 10), frames, 20.0);
  }
  return 0;
}
