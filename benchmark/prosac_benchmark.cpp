// Compares ProsacHomography with cv::findHomography on identical synthetic pairs: time, median
// corner error, share of calls that return a homography, and share that return a wrong homography
// as success (mean corner error above 20 px). Every call gets another scene.

#include <benchmark/benchmark.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <map>
#include <memory>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>
#include <string>
#include <tuple>
#include <vector>

#include "ktgp_orb/prosac_homography.h"
#include "main.h"
#include "synthetic_pairs.h"

namespace ktgp_orb {
namespace {

using test::Order;

constexpr int kScenes = 100;
constexpr double kThreshold = 3.0;  // px
constexpr double kWrong = 20.0;     // px
const cv::Size kSize(640, 480);

struct Case {
  PointPairs pairs;
  std::vector<cv::Point2f> reference, target;  // in order of quality
  Eigen::Matrix3d truth;
};

struct Setting {
  std::size_t pairs;
  int percent;
  Order order;
};

Case makeCase(const Setting& setting, test::Numbers& numbers) {
  test::Scene scene;
  scene.pairs = setting.pairs;
  scene.inliers = setting.pairs * static_cast<std::size_t>(setting.percent) / 100;
  scene.order = setting.order;
  scene.size = kSize;
  scene.homography = test::randomHomography(kSize, 0.15, numbers);
  Case made;
  made.truth = scene.homography;
  made.pairs = test::makePairs(scene, numbers);
  std::vector<std::size_t> order(setting.pairs);
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return made.pairs.quality[a] < made.pairs.quality[b];
  });
  for (std::size_t i : order) {
    made.reference.emplace_back(static_cast<float>(made.pairs.reference[i].x()),
                                static_cast<float>(made.pairs.reference[i].y()));
    made.target.emplace_back(static_cast<float>(made.pairs.target[i].x()),
                             static_cast<float>(made.pairs.target[i].y()));
  }
  return made;
}

/// The scenes of a setting, the same for every estimator.
const std::vector<Case>& casesOf(const Setting& setting) {
  using Key = std::tuple<std::size_t, int, Order>;
  static std::map<Key, std::vector<Case>> cache;
  std::vector<Case>& cases = cache[Key(setting.pairs, setting.percent, setting.order)];
  test::Numbers numbers(setting.pairs + static_cast<std::size_t>(setting.percent));
  while (cases.size() < kScenes) cases.push_back(makeCase(setting, numbers));
  return cases;
}

/// Runs `estimate(const Case&, Matrix3d&) -> bool` on one scene after the other.
template <typename Estimate>
void run(benchmark::State& state, const Setting& setting, Estimate estimate) {
  const std::vector<Case>& cases = casesOf(setting);
  std::vector<double> errors;
  std::size_t next = 0;
  for (auto _ : state) {
    const Case& scene = cases[next++ % cases.size()];
    Eigen::Matrix3d homography;
    if (!estimate(scene, homography)) continue;
    errors.push_back(test::cornerError(homography, scene.truth, kSize));
  }
  const auto calls = static_cast<double>(next);
  const auto wrong =
      std::count_if(errors.begin(), errors.end(), [](double e) { return !(e < kWrong); });
  std::sort(errors.begin(), errors.end());
  state.counters["found_%"] = 100.0 * static_cast<double>(errors.size()) / calls;
  state.counters["wrong_%"] = 100.0 * static_cast<double>(wrong) / calls;
  state.counters["corner_px"] = errors.empty() ? -1.0 : errors[errors.size() / 2];
}

void prosac(benchmark::State& state, const Setting& setting) {
  ProsacHomography estimator;
  ProsacResult result;
  run(state, setting, [&](const Case& scene, Eigen::Matrix3d& homography) {
    estimator.estimate(scene.pairs, kSize, result);
    homography = result.answer.homography;
    return result.status == Status::ok;
  });
}

void openCv(benchmark::State& state, const Setting& setting, int method) {
  run(state, setting, [&](const Case& scene, Eigen::Matrix3d& homography) {
    std::vector<std::uint8_t> mask;
    const cv::Mat h =
        cv::findHomography(scene.reference, scene.target, method, kThreshold, mask, 2000, 0.995);
    if (h.empty()) return false;
    cv::cv2eigen(h, homography);
    return true;
  });
}

void registerAll() {
  const std::pair<const char*, int> peers[] = {{"RANSAC", cv::RANSAC},
                                               {"RHO", cv::RHO},
                                               {"USAC_DEFAULT", cv::USAC_DEFAULT},
                                               {"USAC_MAGSAC", cv::USAC_MAGSAC},
                                               {"USAC_ACCURATE", cv::USAC_ACCURATE},
                                               {"USAC_PROSAC", cv::USAC_PROSAC}};
  const std::pair<const char*, Order> orders[] = {
      {"good", Order::good}, {"random", Order::random}, {"reversed", Order::reversed}};
  const auto add = [](const std::string& name, const auto& function) {
    benchmark::RegisterBenchmark(name.c_str(), function)
        ->Iterations(kScenes)
        ->Unit(benchmark::kMicrosecond);
  };
  for (std::size_t pairs : {30, 100, 300, 1000, 3000}) {
    for (int percent : {90, 50, 25, 10}) {
      for (const auto& [order_name, order] : orders) {
        const Setting setting{pairs, percent, order};
        const std::string suffix = "/N:" + std::to_string(pairs) +
                                   "/inliers:" + std::to_string(percent) + "%/" + order_name;
        add("ProsacHomography" + suffix, [setting](benchmark::State& s) { prosac(s, setting); });
        for (const auto& [name, method] : peers) {
          // With fewer than 100 pairs, OpenCV's PROSAC reads past the end of its arrays.
          if (method == cv::USAC_PROSAC && pairs < 100) continue;
          add(name + suffix,
              [setting, flag = method](benchmark::State& s) { openCv(s, setting, flag); });
        }
      }
    }
  }
}

}  // namespace
}  // namespace ktgp_orb

int main(int argc, char** argv) {
  cv::setNumThreads(1);
  return ktgp_orb::bench::run(argc, argv, ktgp_orb::registerAll);
}
