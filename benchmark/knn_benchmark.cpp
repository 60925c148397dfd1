// Compares the search for two nearest neighbours of N descriptors among N with OpenCV's exact and
// approximate matchers: every kernel of this processor, one and two threads. Arguments of a name:
// N, threads.
//
//   ns_per_pair      median time over N * N: CPU time for one thread, wall-clock time for two
//   times_BFMatcher  how many times as fast as cv::BFMatcher on as many threads, medians of calls
//                    that alternate
//   times_one_way    mutual only: its time over the time of the search in one direction, medians
//                    of calls that alternate
//   times_whole      near only: how many times as fast as the search of the whole image
//
// "near" searches within a radius, px, of the predicted positions. Keypoints are spread evenly over
// an image of `width` px with the aspect ratio 16:9, or 4:3 if the width is below 1000.
//
// Descriptors are from ORB on the images in KTGP_ORB_DATA, or generated if that is not set.

#include <benchmark/benchmark.h>

#include <algorithm>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/flann.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "files/input.h"
#include "instruction_sets.h"
#include "ktgp_orb/metrics.h"
#include "main.h"
#include "matching/knn/near_search.h"
#include "matching/knn/search.h"
#include "support.h"

namespace {

using ktgp_orb::Correspondence;
using ktgp_orb::bench::milliseconds;
using ktgp_orb::knn::KnnKernel;
using ktgp_orb::knn::KnnSearch;
using ktgp_orb::knn::NearSearch;

/// At least `count` ORB descriptors of an image and its enlargements.
cv::Mat orbDescriptors(const std::string& file, int count) {
  const cv::Mat image = ktgp_orb::files::readGrey(file);
  cv::Mat all;
  for (double scale = 1.0; all.rows < count && scale < 8.0; scale *= 1.3) {
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
    const auto folder = ktgp_orb::bench::oxfordFolder();
    if (!folder)
      return {generatedDescriptors(count, 1), generatedDescriptors(count, 2), "generated"};
    const auto descriptors = [&](int number) {
      return orbDescriptors(ktgp_orb::bench::oxfordImage(*folder, "bikes", number), count);
    };
    return {descriptors(1), descriptors(2), "ORB of oxford/bikes 1 and 2"};
  }
};

void bruteForce(const cv::Mat& reference, const cv::Mat& target) {
  std::vector<std::vector<cv::DMatch>> matches;
  cv::BFMatcher(cv::NORM_HAMMING).knnMatch(target, reference, matches, 2);
  benchmark::DoNotOptimize(matches.data());
}

/// Changes the reference, so that the index must be built again, as for every frame of a video.
void renew(cv::Mat& reference) {
  *reference.data ^= 1;
}

/// Times `match` and reports the time per pair and, if wanted, the ratio to BFMatcher.
template <typename Match>
void run(benchmark::State& state, const Frames& frames, bool beside_brute_force, Match match) {
  const auto n = static_cast<int>(state.range(0));
  const bool one_thread = state.range(1) == 1;
  cv::Mat reference = frames.reference.rowRange(0, n).clone();
  const cv::Mat target = frames.target.rowRange(0, n);
  cv::setNumThreads(static_cast<int>(state.range(1)));
  match(reference, target);  // buffers grow, threads wake up
  const std::size_t brute_force_calls = !beside_brute_force ? 0 : n <= 2000 ? 9 : n <= 5000 ? 5 : 1;
  std::vector<double> brute_force_times;
  std::vector<double> times;
  for (auto _ : state) {
    if (brute_force_times.size() < brute_force_calls) {
      state.PauseTiming();
      const double start = milliseconds(one_thread);
      bruteForce(reference, target);
      brute_force_times.push_back(milliseconds(one_thread) - start);
      state.ResumeTiming();
    }
    renew(reference);
    const double start = milliseconds(one_thread);
    match(reference, target);
    times.push_back(milliseconds(one_thread) - start);
  }
  const double time = ktgp_orb::metrics::median(times);
  state.counters["ns_per_pair"] = time * 1e6 / n / n;
  if (!brute_force_times.empty())
    state.counters["times_BFMatcher"] = ktgp_orb::metrics::median(brute_force_times) / time;
  state.SetLabel(frames.source);
}

/// Compares the search in both directions with the search in one direction.
void runMutual(benchmark::State& state, const Frames& frames, const KnnKernel& kernel) {
  const auto n = static_cast<int>(state.range(0));
  const bool one_thread = state.range(1) == 1;
  cv::Mat reference = frames.reference.rowRange(0, n).clone();
  const cv::Mat target = frames.target.rowRange(0, n);
  KnnSearch search(kernel, static_cast<int>(state.range(1)));
  std::vector<Correspondence> result;
  std::vector<double> one_way_times;
  std::vector<double> times;
  search.match(reference, target, true, result);  // buffers grow, threads wake up
  for (auto _ : state) {
    state.PauseTiming();
    renew(reference);
    double start = milliseconds(one_thread);
    search.match(reference, target, false, result);
    one_way_times.push_back(milliseconds(one_thread) - start);
    state.ResumeTiming();
    renew(reference);
    start = milliseconds(one_thread);
    search.match(reference, target, true, result);
    times.push_back(milliseconds(one_thread) - start);
  }
  const double time = ktgp_orb::metrics::median(times);
  state.counters["ns_per_pair"] = time * 1e6 / n / n;
  state.counters["times_one_way"] = time / ktgp_orb::metrics::median(one_way_times);
  state.SetLabel(frames.source);
}

ktgp_orb::Features spread(const cv::Mat& descriptors, int width, int seed) {
  ktgp_orb::Features features;
  features.image_size = {width, width < 1000 ? width * 3 / 4 : width * 9 / 16};
  features.descriptors = descriptors;
  cv::RNG random(static_cast<std::uint64_t>(seed));
  for (int i = 0; i < descriptors.rows; ++i) {
    features.keypoints.emplace_back(
        random.uniform(0.F, static_cast<float>(features.image_size.width)),
        random.uniform(0.F, static_cast<float>(features.image_size.height)), 31.F);
  }
  return features;
}

/// Compares the search near predicted positions with the whole image; each call builds the index.
void runNear(benchmark::State& state, const Frames& frames, const KnnKernel& kernel,
             const KnnKernel& whole_kernel) {
  const auto n = static_cast<int>(state.range(0));
  const auto width = static_cast<int>(state.range(1));
  auto reference = spread(frames.reference.rowRange(0, n).clone(), width, 1);
  const auto target = spread(frames.target.rowRange(0, n), width, 2);
  KnnSearch whole(whole_kernel, 1);
  NearSearch near(kernel, static_cast<double>(state.range(2)), whole.pool());
  const Eigen::Matrix3d here = Eigen::Matrix3d::Identity();
  std::vector<Correspondence> result;
  std::vector<double> whole_times;
  std::vector<double> times;
  near.match(reference, target, here, false, result);  // buffers grow
  for (auto _ : state) {
    if (whole_times.size() < (n <= 2000 ? 9U : 3U)) {
      state.PauseTiming();
      renew(reference.descriptors);
      const double start = milliseconds(true);
      whole.match(reference.descriptors, target.descriptors, false, result);
      whole_times.push_back(milliseconds(true) - start);
      state.ResumeTiming();
    }
    renew(reference.descriptors);
    const double start = milliseconds(true);
    near.match(reference, target, here, false, result);
    times.push_back(milliseconds(true) - start);
  }
  const double time = ktgp_orb::metrics::median(times);
  state.counters["ms"] = time;
  state.counters["times_whole"] = ktgp_orb::metrics::median(whole_times) / time;
  state.SetLabel(frames.source);
}

void registerNear(const Frames& frames) {
  const auto whole = ktgp_orb::test::everyKernels(ktgp_orb::knn::bestKnnKernel,
                                                  ktgp_orb::knn::portableKnnKernel());
  for (const KnnKernel* kernel : ktgp_orb::test::everyKernels(ktgp_orb::knn::bestKnnKernel,
                                                              ktgp_orb::knn::portableKnnKernel())) {
    const KnnKernel* same = whole.back();
    for (const KnnKernel* candidate : whole) {
      if (std::string(candidate->name) == kernel->name) same = candidate;
    }
    benchmark::RegisterBenchmark(
        ("knn/" + std::string(kernel->name) + "/near").c_str(),
        [&frames, kernel, same](benchmark::State& s) { runNear(s, frames, *kernel, *same); })
        ->ArgNames({"n", "width", "radius"})
        ->Unit(benchmark::kMillisecond)
        ->Args({2000, 640, 24})
        ->Args({2000, 640, 48})
        ->Args({2000, 640, 96})
        ->Args({20000, 1920, 48});
  }
}

void registerAll(const Frames& frames) {
  const auto add = [&](const std::string& name, auto function) {
    auto* benchmark = benchmark::RegisterBenchmark(("knn/" + name).c_str(), function);
    benchmark->ArgNames({"n", "threads"})->Unit(benchmark::kMillisecond)->UseRealTime();
    for (int threads : {1, 2}) {
      for (int n : {500, 1000, 2000, 5000, 10000, 20000}) benchmark->Args({n, threads});
    }
  };
  for (const KnnKernel* chosen : ktgp_orb::test::everyKernels(ktgp_orb::knn::bestKnnKernel,
                                                              ktgp_orb::knn::portableKnnKernel())) {
    const KnnKernel& kernel = *chosen;
    add(kernel.name, [&frames, kernel](benchmark::State& state) {
      KnnSearch search(kernel, static_cast<int>(state.range(1)));
      std::vector<Correspondence> result;
      run(state, frames, true, [&](const cv::Mat& reference, const cv::Mat& target) {
        search.match(reference, target, false, result);
      });
    });
    add(std::string(kernel.name) + "/mutual",
        [&frames, kernel](benchmark::State& state) { runMutual(state, frames, kernel); });
  }
  add("BFMatcher", [&frames](benchmark::State& state) { run(state, frames, false, bruteForce); });
  add("FlannLSH", [&frames](benchmark::State& state) {
    run(state, frames, true, [](const cv::Mat& reference, const cv::Mat& target) {
      std::vector<std::vector<cv::DMatch>> matches;
      // The index is built for every frame, as in a video.
      cv::FlannBasedMatcher(cv::makePtr<cv::flann::LshIndexParams>(12, 20, 2))
          .knnMatch(target, reference, matches, 2);
      benchmark::DoNotOptimize(matches.data());
    });
  });
}

}  // namespace

int main(int argc, char** argv) {
  return ktgp_orb::bench::run(argc, argv, [] {
    static const Frames frames = Frames::load(20000);
    registerAll(frames);
    registerNear(frames);
  });
}
