// Compares ORB extraction with cv::ORB on the same images, with equal results. Arguments of a name:
// image width and height, features, our threads; cv::ORB has one thread.
//
//   ms           median of one image: CPU time for one thread, wall-clock time for more
//   times_cvORB  how many times as fast as cv::ORB, medians of calls that alternate
//   keypoints    keypoints found
//   more_ms      TEBLID only: additional time compared with ORB's own descriptors, medians of
//                calls that alternate
//
// The images are scaled from the first image of the Leuven set in KTGP_ORB_DATA. If this variable
// is not set, they are noise of several scales.

#include <benchmark/benchmark.h>

#include <algorithm>
#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "files/input.h"
#include "ktgp_orb/metrics.h"
#include "ktgp_orb/orb_extractor.h"
#include "main.h"
#include "support.h"

namespace {

using ktgp_orb::Features;
using ktgp_orb::KeypointDistribution;
using ktgp_orb::OrbExtractor;
using ktgp_orb::OrbOptions;
using ktgp_orb::bench::milliseconds;

cv::Mat noiseOfSeveralScales(const cv::Size& size) {
  cv::Mat sum = cv::Mat::zeros(size, CV_32F);
  cv::RNG rng(1);
  for (int period = 2; period <= 32; period *= 2) {
    cv::Mat coarse(size.height / period + 2, size.width / period + 2, CV_8U);
    rng.fill(coarse, cv::RNG::UNIFORM, 0, 256);
    cv::resize(coarse, coarse, size, 0, 0, cv::INTER_CUBIC);
    cv::accumulateWeighted(coarse, sum, 0.4);
  }
  cv::Mat image;
  cv::normalize(sum, image, 0, 255, cv::NORM_MINMAX, CV_8U);
  return image;
}

cv::Mat imageOf(const cv::Size& size) {
  const auto folder = ktgp_orb::bench::oxfordFolder();
  if (!folder) return noiseOfSeveralScales(size);
  cv::Mat image = ktgp_orb::files::readGrey(ktgp_orb::bench::oxfordImage(*folder, "leuven", 1));
  cv::resize(image, image, size, 0, 0, size.width < image.cols ? cv::INTER_AREA : cv::INTER_CUBIC);
  return image;
}

class OpencvOrb {
 public:
  explicit OpencvOrb(const OrbOptions& o)
      : orb_(cv::ORB::create(o.max_features, static_cast<float>(o.scale_factor), o.levels, 31, 0, 2,
                             cv::ORB::HARRIS_SCORE, 31, o.fast_threshold)) {}

  double timed(const cv::Mat& image, bool one_thread) {
    const double start = milliseconds(one_thread);
    orb_->detectAndCompute(image, cv::noArray(), features_.keypoints, features_.descriptors);
    return milliseconds(one_thread) - start;
  }

 private:
  cv::Ptr<cv::ORB> orb_;
  Features features_;
};

void extract(benchmark::State& state, KeypointDistribution distribution) {
  const cv::Mat image =
      imageOf(cv::Size(static_cast<int>(state.range(0)), static_cast<int>(state.range(1))));
  OrbOptions options;
  options.max_features = static_cast<int>(state.range(2));
  options.threads = static_cast<int>(state.range(3));
  options.distribution = distribution;
  const bool one_thread = options.threads == 1;
  cv::setNumThreads(1);
  OrbExtractor ours(options);
  OpencvOrb opencv(options);
  Features features;
  for (int i = 0; i < 3; ++i) ours.extract(image, features);  // buffers grow, threads wake up
  std::vector<double> times;
  std::vector<double> opencv_times;
  for (auto _ : state) {
    const double start = milliseconds(one_thread);
    ours.extract(image, features);
    times.push_back(milliseconds(one_thread) - start);
    state.PauseTiming();
    if (opencv_times.size() < 101) opencv_times.push_back(opencv.timed(image, one_thread));
    state.ResumeTiming();
  }
  const double time = ktgp_orb::metrics::median(times);
  state.counters["ms"] = time;
  state.counters["times_cvORB"] = ktgp_orb::metrics::median(opencv_times) / time;
  state.counters["keypoints"] = static_cast<double>(features.size());
}

void arguments(benchmark::internal::Benchmark* benchmark) {
  benchmark->ArgNames({"width", "height", "features", "threads"});
  benchmark->Unit(benchmark::kMillisecond)->UseRealTime();
  const std::vector<std::pair<int, int>> sizes = {
      {320, 240}, {640, 480}, {1280, 720}, {1920, 1080}};
  for (const auto& [width, height] : sizes) {
    for (int features : {500, 1000, 2000, 5000}) {
      for (int threads : {1, 2}) benchmark->Args({width, height, features, threads});
    }
  }
}

// Compares TEBLID with ORB's own descriptors for the same keypoints, on one thread.
void teblid(benchmark::State& state) {
  const cv::Mat image =
      imageOf(cv::Size(static_cast<int>(state.range(0)), static_cast<int>(state.range(1))));
  OrbOptions options;
  options.max_features = static_cast<int>(state.range(2));
  OrbExtractor orb(options);
  options.descriptor = ktgp_orb::DescriptorKind::teblid;
  OrbExtractor teblid(options);
  Features features;
  const auto timed = [&](OrbExtractor& extractor) {
    const double start = milliseconds(true);
    extractor.extract(image, features);
    return milliseconds(true) - start;
  };
  for (OrbExtractor* extractor : {&orb, &teblid}) timed(*extractor);  // buffers grow
  std::vector<double> times;
  std::vector<double> orb_times;
  for (auto _ : state) {
    times.push_back(timed(teblid));
    state.PauseTiming();
    orb_times.push_back(timed(orb));
    state.ResumeTiming();
  }
  state.counters["ms"] = ktgp_orb::metrics::median(times);
  state.counters["more_ms"] =
      ktgp_orb::metrics::median(times) - ktgp_orb::metrics::median(orb_times);
  state.counters["keypoints"] = static_cast<double>(features.size());
}

BENCHMARK(teblid)
    ->ArgNames({"width", "height", "features"})
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime()
    ->ArgsProduct({{640}, {480}, {500, 1000, 2000, 5000}})
    ->Args({1920, 1080, 5000});
BENCHMARK_CAPTURE(extract, ranked, KeypointDistribution::ranked)->Apply(arguments);
BENCHMARK_CAPTURE(extract, uniform, KeypointDistribution::uniform)->Apply(arguments);

}  // namespace

int main(int argc, char** argv) {
  return ktgp_orb::bench::run(argc, argv);
}
