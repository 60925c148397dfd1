// Two nearest neighbours of N descriptors among N: every kernel this processor has, beside OpenCV's
// exact and approximate matchers, on one thread and on two. Arguments of a name: N, threads.
//
//   ns_per_pair      median time over N * N: CPU time for one thread, wall-clock time for two
//   times_BFMatcher  how many times as fast as cv::BFMatcher on as many threads, medians of calls
//                    that alternate
//   times_one_way    mutual only: its time over that of the search in one direction, medians of
//                    calls that alternate
//
// Descriptors are ORB's of the images in KTGP_ORB_DATA, or generated where that is not set.

#include <benchmark/benchmark.h>
#include <time.h>

#include <algorithm>
#include <cstdlib>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/flann.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "core/knn/search.h"
#include "instruction_sets.h"
#include "ktgp_orb/evaluation.h"

namespace {

using ktgp_orb::Correspondence;
using ktgp_orb::KnnKernel;
using ktgp_orb::KnnSearch;

/// One thread: its CPU time, which other programs do not disturb. More: wall-clock time.
double seconds(bool one_thread) {
  timespec time{};
  clock_gettime(one_thread ? CLOCK_THREAD_CPUTIME_ID : CLOCK_MONOTONIC, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

/// At least `count` ORB descriptors of an image and its enlargements, or none without the image.
cv::Mat orbDescriptors(const std::string& file, int count) {
  const cv::Mat image = cv::imread(file, cv::IMREAD_GRAYSCALE);
  cv::Mat all;
  for (double scale = 1.0; !image.empty() && all.rows < count && scale < 8.0; scale *= 1.3) {
    cv::Mat scaled;
    cv::resize(image, scaled, cv::Size(), scale, scale);
    std::vector<cv::KeyPoint> keypoints;
    cv::Mat descriptors;
    cv::ORB::create(count - all.rows, 1.2F, 8, 31, 0, 2, cv::ORB::HARRIS_SCORE, 31, 5)
        ->detectAndCompute(scaled, cv::noArray(), keypoints, descriptors);
    all.push_back(descriptors);
  }
  return all;
}

cv::Mat generatedDescriptors(int count, int seed) {
  cv::Mat descriptors(count, ktgp_orb::kDescriptorBytes, CV_8U);
  cv::RNG(static_cast<std::uint64_t>(seed)).fill(descriptors, cv::RNG::UNIFORM, 0, 256);
  return descriptors;
}

struct Frames {
  cv::Mat reference;
  cv::Mat target;
  std::string source;

  static Frames load(int count) {
    const char* data = std::getenv("KTGP_ORB_DATA");
    const std::string folder = data != nullptr ? std::string(data) + "/oxford/bikes/" : "";
    Frames frames{orbDescriptors(folder + "img1.ppm", count),
                  orbDescriptors(folder + "img2.ppm", count), "ORB of oxford/bikes 1 and 2"};
    if (frames.reference.rows >= count && frames.target.rows >= count) return frames;
    return {generatedDescriptors(count, 1), generatedDescriptors(count, 2), "generated"};
  }
};

void bruteForce(const cv::Mat& reference, const cv::Mat& target) {
  std::vector<std::vector<cv::DMatch>> matches;
  cv::BFMatcher(cv::NORM_HAMMING).knnMatch(target, reference, matches, 2);
  benchmark::DoNotOptimize(matches.data());
}

/// Times `match` and reports it per pair and, if asked for, against BFMatcher.
template <typename Match>
void run(benchmark::State& state, const Frames& frames, bool beside_brute_force, Match match) {
  const auto n = static_cast<int>(state.range(0));
  const bool one_thread = state.range(1) == 1;
  const cv::Mat reference = frames.reference.rowRange(0, n);
  const cv::Mat target = frames.target.rowRange(0, n);
  cv::setNumThreads(static_cast<int>(state.range(1)));
  match(reference, target);  // buffers grow, threads wake up
  const std::size_t brute_force_calls = !beside_brute_force ? 0 : n <= 2000 ? 9 : n <= 5000 ? 5 : 1;
  std::vector<double> brute_force_times;
  std::vector<double> times;
  for (auto _ : state) {
    if (brute_force_times.size() < brute_force_calls) {
      state.PauseTiming();
      const double start = seconds(one_thread);
      bruteForce(reference, target);
      brute_force_times.push_back(seconds(one_thread) - start);
      state.ResumeTiming();
    }
    const double start = seconds(one_thread);
    match(reference, target);
    times.push_back(seconds(one_thread) - start);
  }
  const double time = ktgp_orb::evaluation::median(times);
  state.counters["ns_per_pair"] = time * 1e9 / n / n;
  if (!brute_force_times.empty())
    state.counters["times_BFMatcher"] = ktgp_orb::evaluation::median(brute_force_times) / time;
  state.SetLabel(frames.source);
}

/// Both directions beside one.
void runMutual(benchmark::State& state, const Frames& frames, const KnnKernel& kernel) {
  const auto n = static_cast<int>(state.range(0));
  const bool one_thread = state.range(1) == 1;
  const cv::Mat reference = frames.reference.rowRange(0, n);
  const cv::Mat target = frames.target.rowRange(0, n);
  KnnSearch search(kernel, static_cast<int>(state.range(1)));
  std::vector<Correspondence> result;
  std::vector<double> one_way_times;
  std::vector<double> times;
  search.matchMutual(reference, target, result);  // buffers grow, threads wake up
  for (auto _ : state) {
    state.PauseTiming();
    double start = seconds(one_thread);
    search.match(reference, target, result);
    one_way_times.push_back(seconds(one_thread) - start);
    state.ResumeTiming();
    start = seconds(one_thread);
    search.matchMutual(reference, target, result);
    times.push_back(seconds(one_thread) - start);
  }
  const double time = ktgp_orb::evaluation::median(times);
  state.counters["ns_per_pair"] = time * 1e9 / n / n;
  state.counters["times_one_way"] = time / ktgp_orb::evaluation::median(one_way_times);
  state.SetLabel(frames.source);
}

void registerAll(const Frames& frames) {
  const auto add = [&](const std::string& name, auto function) {
    auto* benchmark = benchmark::RegisterBenchmark(("knn/" + name).c_str(), function);
    benchmark->ArgNames({"n", "threads"})->Unit(benchmark::kMillisecond)->UseRealTime();
    for (int threads : {1, 2}) {
      for (int n : {500, 1000, 2000, 5000, 10000, 20000}) benchmark->Args({n, threads});
    }
  };
  for (const KnnKernel* chosen :
       ktgp_orb::test::everyKernels(ktgp_orb::bestKnnKernel, ktgp_orb::portableKnnKernel())) {
    const KnnKernel& kernel = *chosen;
    add(kernel.name, [&frames, kernel](benchmark::State& state) {
      KnnSearch search(kernel, static_cast<int>(state.range(1)));
      std::vector<Correspondence> result;
      run(state, frames, true, [&](const cv::Mat& reference, const cv::Mat& target) {
        search.match(reference, target, result);
      });
    });
    add(std::string(kernel.name) + "/mutual",
        [&frames, kernel](benchmark::State& state) { runMutual(state, frames, kernel); });
  }
  add("BFMatcher", [&frames](benchmark::State& state) { run(state, frames, false, bruteForce); });
  add("FlannLSH", [&frames](benchmark::State& state) {
    run(state, frames, true, [](const cv::Mat& reference, const cv::Mat& target) {
      std::vector<std::vector<cv::DMatch>> matches;
      // The index is built for every frame, as the pipeline would have to.
      cv::FlannBasedMatcher(cv::makePtr<cv::flann::LshIndexParams>(12, 20, 2))
          .knnMatch(target, reference, matches, 2);
      benchmark::DoNotOptimize(matches.data());
    });
  });
}

}  // namespace

int main(int argc, char** argv) {
  const Frames frames = Frames::load(20000);
  registerAll(frames);
  benchmark::Initialize(&argc, argv);
  if (benchmark::ReportUnrecognizedArguments(argc, argv)) return 1;
  benchmark::RunSpecifiedBenchmarks();
  return 0;
}
