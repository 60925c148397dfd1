// Measures two-view geometry on drawn scenes with depth, on one thread: search, fit, choice and
// covariance of N pairs, compared with OpenCV's five-point estimators. Also measures the alignment
// of N matches, each by itself.
//
//   ms        median CPU time of a call
//   turn_deg  median error of the rotation
//   found     share of scenes with a pose
//
// Arguments of a name: N, and the percentage of right pairs. The noise is 0.5 px.

#include <benchmark/benchmark.h>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <opencv2/core/eigen.hpp>
#include <opencv2/core/version.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "features/alignment/local_maps.h"
#include "features/alignment/patch_aligner.h"
#include "ktgp_orb/metrics.h"
#include "ktgp_orb/two_view.h"
#include "main.h"
#include "support.h"
#include "synthetic_pairs.h"

namespace {

using ktgp_orb::PointPairs;
using ktgp_orb::bench::milliseconds;
using ktgp_orb::test::Numbers;

const cv::Size kSize(1226, 370);
constexpr int kScenes = 50;

Eigen::Matrix3d camera() {
  Eigen::Matrix3d k;
  k << 718.9, 0.0, 607.2, 0.0, 718.9, 185.2, 0.0, 0.0, 1.0;
  return k;
}

struct Scene {
  Eigen::Matrix3d rotation;
  PointPairs pairs;

  Scene(std::size_t count, double right, Numbers& numbers) {
    const Eigen::Vector3d axis(numbers.normal(), numbers.normal(), numbers.normal());
    rotation = Eigen::AngleAxisd(numbers.uniform(0.0, 0.1), axis.normalized()).toRotationMatrix();
    const Eigen::Vector3d t(0.2 * numbers.normal(), 0.1 * numbers.normal(), -1.0);
    const auto rights = static_cast<std::size_t>(right * static_cast<double>(count));
    while (pairs.size() < count) {
      const bool is_right = pairs.size() < rights;
      const Eigen::Vector2d x = numbers.pointIn(kSize);
      Eigen::Vector2d u = numbers.pointIn(kSize);
      if (is_right) {
        const Eigen::Vector3d p = rotation * (numbers.uniform(4.0, 40.0) *
                                              (camera().inverse() * x.homogeneous()).eval()) +
                                  t;
        u = (camera() * p).hnormalized();
        if (!(p.z() > 0.5) || !ktgp_orb::test::isInside(u, kSize)) continue;
        u += 0.5 * Eigen::Vector2d(numbers.normal(), numbers.normal());
      }
      pairs.reference.push_back(x + 0.5 * Eigen::Vector2d(numbers.normal(), numbers.normal()));
      pairs.target.push_back(u);
      pairs.quality.push_back(
          ktgp_orb::test::qualityOf(is_right, ktgp_orb::test::Order::good, numbers));
    }
  }
};

double turnError(const Eigen::Matrix3d& a, const Eigen::Matrix3d& b) {
  return Eigen::AngleAxisd(a * b.transpose()).angle() * 180.0 / M_PI;
}

/// `call` sets the rotation that it finds, and returns false if it finds none.
template <typename Call>
void run(benchmark::State& state, Call call) {
  Numbers numbers(1);
  std::vector<Scene> scenes;
  for (int i = 0; i < kScenes; ++i) {
    scenes.emplace_back(state.range(0), 0.01 * static_cast<double>(state.range(1)), numbers);
  }
  std::vector<double> times;
  std::vector<double> errors;
  double found = 0.0;
  for (auto _ : state) {
    for (const Scene& scene : scenes) {
      Eigen::Matrix3d rotation;
      const double start = milliseconds(true);
      const bool ok = call(scene.pairs, rotation);
      times.push_back(milliseconds(true) - start);
      found += ok;
      errors.push_back(ok ? turnError(rotation, scene.rotation) : 180.0);
    }
  }
  state.counters["ms"] = ktgp_orb::metrics::median(times);
  state.counters["turn_deg"] = ktgp_orb::metrics::median(errors);
  state.counters["found"] = found / static_cast<double>(times.size());
}

void twoView(benchmark::State& state) {
  ktgp_orb::TwoViewEstimator estimator;
  ktgp_orb::TwoView view;
  ktgp_orb::TwoViewInput input;
  input.reference_camera = camera();
  input.reference_size = input.target_size = kSize;
  run(state, [&](const PointPairs& pairs, Eigen::Matrix3d& rotation) {
    estimator.estimate(pairs, input, view);
    rotation = view.pose.rotation;
    return view.geometry == ktgp_orb::Geometry::epipolar;
  });
}

void openCv(benchmark::State& state, int method) {
  cv::Mat k;
  cv::eigen2cv(camera(), k);
  run(state, [&](const PointPairs& pairs, Eigen::Matrix3d& rotation) {
    std::vector<cv::Point2d> a;
    std::vector<cv::Point2d> b;
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      a.emplace_back(pairs.reference[i].x(), pairs.reference[i].y());
      b.emplace_back(pairs.target[i].x(), pairs.target[i].y());
    }
    cv::Mat mask;
    cv::Mat r;
    cv::Mat t;
    const cv::Mat e = cv::findEssentialMat(a, b, k, method, 0.999, 1.0, mask);
    if (e.rows != 3) return false;
    cv::recoverPose(e, a, b, k, r, t, mask);
    cv::cv2eigen(r, rotation);
    return true;
  });
}

/// Aligns every match by the map that its twelve neighbours suggest. The scene is a plane.
void alignMatches(benchmark::State& state) {
  Numbers numbers(2);
  cv::Mat noise(480, 640, CV_32FC1);
  for (int i = 0; i < 480 * 640; ++i) {
    noise.at<float>(i / 640, i % 640) = static_cast<float>(numbers.uniform(0.0, 1.0));
  }
  cv::GaussianBlur(noise, noise, {}, 2.0);
  cv::Mat image;
  cv::normalize(noise, image, 0.0, 255.0, cv::NORM_MINMAX, CV_8U);
  const std::vector<cv::Mat> images{image};
  std::vector<Eigen::Vector2d> from;
  std::vector<Eigen::Vector2d> to;
  for (int i = 0; i < state.range(0); ++i) {
    from.emplace_back(numbers.uniform(40.0, 600.0), numbers.uniform(40.0, 440.0));
    to.push_back(from.back() + 0.7 * Eigen::Vector2d(numbers.normal(), numbers.normal()));
  }
  ktgp_orb::alignment::LocalMaps maps;
  ktgp_orb::alignment::PatchAligner aligner(ktgp_orb::alignment::bestAlignmentKernels());
  std::vector<double> times;
  double aligned = 0.0;
  for (auto _ : state) {
    const double start = milliseconds(true);
    maps.load(from, to, image.size());
    aligner.setImages(images, images);
    aligned = 0.0;
    for (std::size_t i = 0; i < from.size(); ++i) {
      const auto patch = aligner.align(maps.at(i), from[i], 4.0);
      aligned += patch.outcome == ktgp_orb::alignment::PatchOutcome::aligned;
    }
    times.push_back(milliseconds(true) - start);
  }
  state.counters["ms"] = ktgp_orb::metrics::median(times);
  state.counters["aligned"] = aligned;
}

BENCHMARK(twoView)->Args({500, 90})->Args({500, 40})->Iterations(4);
BENCHMARK_CAPTURE(openCv, ransac, cv::RANSAC)->Args({500, 90})->Args({500, 40})->Iterations(1);
#if CV_VERSION_MAJOR > 4 || (CV_VERSION_MAJOR == 4 && CV_VERSION_MINOR > 5)
BENCHMARK_CAPTURE(openCv, magsac, cv::USAC_MAGSAC)->Args({500, 90})->Args({500, 40})->Iterations(1);
#endif
BENCHMARK(alignMatches)->Arg(500)->Iterations(100);

}  // namespace

int main(int argc, char** argv) {
  return ktgp_orb::bench::run(argc, argv);
}
