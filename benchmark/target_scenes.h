#pragma once

#include <time.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "ktgp_orb/orb_extractor.h"
#include "ktgp_orb/target_finder.h"
#include "target_world.h"

// What the measurements of many targets have in common: targets, and frames that show them.
namespace ktgp_orb::test {

constexpr double kWide = 120.0;  // px
inline const cv::Size kFrame(640, 480);
constexpr std::size_t kBackgrounds = 5;

/// Of this process, which other programs do not slow down.
inline double processorMilliseconds() {
  timespec time{};
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time);
  return 1e3 * static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_nsec);
}

inline double memoryInMegabytes() {
  std::ifstream file("/proc/self/statm");
  double size = 0.0;
  double resident = 0.0;
  file >> size >> resident;
  return resident * 4096.0 / 1e6;
}

/// The photographs, one of each scene.
inline std::vector<cv::Mat> photographs() {
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
inline World makeWorld(std::size_t count) {
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
    world.backgrounds.push_back(drawnPicture(kFrame, 900000U + static_cast<unsigned>(i)));
  }
  // Spread over the photographs, half of the targets if there are enough.
  const std::size_t photos = std::min(tiles.size(), count / 2);
  for (std::size_t i = 0; i < count; ++i) {
    Target target;
    target.id = "t" + std::to_string(i);
    const cv::Size size = i % 2 == 0 ? cv::Size(360, 270) : cv::Size(270, 380);
    target.images = {i < photos ? tiles[i * tiles.size() / std::max<std::size_t>(photos, 1)].clone()
                                : drawnPicture(size, i)};
    world.targets.push_back(target);
  }
  return world;
}

/// Leaves out those that are refused, since they show the same as another one.
inline void addAll(World& world, TargetFinder& finder) {
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

inline cv::Mat lit(cv::Mat frame, Numbers& numbers, cv::RNG& rng) {
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
inline View makeView(const World& world, std::uint64_t seed) {
  Numbers numbers(seed);
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
    Placement p;
    p.tilt = numbers.uniform(0.0, M_PI / 3.0);
    p.axis = numbers.uniform(0.0, 2.0 * M_PI);
    p.turn = numbers.uniform(-M_PI, M_PI);
    p.zoom = std::exp(numbers.uniform(-std::log(3.0), std::log(3.0)));
    p.middle = {numbers.uniform(100.0, 540.0), numbers.uniform(80.0, 400.0)};
    const Eigen::Matrix3d h = homographyOf(p, size);
    Eigen::Matrix<double, 2, 4> outline;
    for (int i = 0; i < 4; ++i) {
      outline.col(i) = apply(h, corners(size)[static_cast<std::size_t>(i)]);
    }
    // At least so wide, and mostly in view when it is small.
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
    place(world.targets[t].images[0], h, frame);
    view.truths.push_back({t, h, p.tilt * 180.0 / M_PI, p.zoom});
  }
  view.image = lit(frame, numbers, rng);
  return view;
}

inline double percentile(std::vector<double> values, double share) {
  if (values.empty()) return 0.0;
  const auto place = static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + place, values.end());
  return values[static_cast<std::size_t>(place)];
}

inline double percent(std::size_t part, std::size_t all) {
  return all == 0 ? 0.0 : 100.0 * static_cast<double>(part) / static_cast<double>(all);
}

}  // namespace ktgp_orb::test
