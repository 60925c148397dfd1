// Compares GmsFilter with a dense implementation of the same method on the same 200 to 50000
// matches, in the four modes. Before the timing, the two masks are compared.
//
// 90 % of the matches follow a motion (a rotation of 7 degrees and a zoom of 1.05), and the others
// are random. After the ratio test 93 to 96 % are correct on the Oxford sets
// (doc/measurements/gms.md). The frames are 1920x1080, so that 50000 keypoints fit. The calls use
// eight problems in turn, as in a video. With a single problem the processor would predict every
// branch.

#include <benchmark/benchmark.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "dense_gms.h"
#include "ktgp_orb/gms_filter.h"
#include "main.h"

namespace {

using ktgp_orb::Correspondence;
using ktgp_orb::Features;
using ktgp_orb::GmsFilter;
using ktgp_orb::GmsOptions;
using ktgp_orb::Level;

constexpr int kWidth = 1920;
constexpr int kHeight = 1080;

struct Problem {
  Features reference, target;
  std::vector<Correspondence> matches;
};

constexpr double kInliers = 0.9;
constexpr unsigned kProblems = 8;

Problem makeProblem(int size, unsigned seed) {
  Problem problem;
  problem.reference.image_size = problem.target.image_size = {kWidth, kHeight};
  std::mt19937 random(seed);
  std::uniform_real_distribution<float> x(0.0F, kWidth);
  std::uniform_real_distribution<float> y(0.0F, kHeight);
  std::bernoulli_distribution inlier(kInliers);
  const float c = 1.05F * std::cos(0.12F);
  const float s = 1.05F * std::sin(0.12F);
  while (static_cast<int>(problem.matches.size()) < size) {
    const cv::Point2f r(x(random), y(random));
    cv::Point2f t(x(random), y(random));
    if (inlier(random)) {
      const cv::Point2f d(r.x - kWidth / 2.0F, r.y - kHeight / 2.0F);
      t = {c * d.x - s * d.y + kWidth / 2.0F, s * d.x + c * d.y + kHeight / 2.0F};
      if (t.x < 0 || t.y < 0 || t.x >= kWidth || t.y >= kHeight) continue;
    }
    const auto n = static_cast<std::int32_t>(problem.matches.size());
    problem.reference.keypoints.emplace_back(r, 31.0F);
    problem.target.keypoints.emplace_back(t, 31.0F);
    problem.matches.push_back({n, n, 10, 20, Level::kt});
  }
  return problem;
}

GmsOptions optionsOf(const benchmark::State& state) {
  GmsOptions options;
  options.rotation = (state.range(1) & 1) != 0;
  options.scale = (state.range(1) & 2) != 0;
  return options;
}

std::vector<Problem> problemsOf(const benchmark::State& state) {
  std::vector<Problem> problems;
  for (unsigned seed = 1; seed <= kProblems; ++seed) {
    problems.push_back(makeProblem(static_cast<int>(state.range(0)), seed));
  }
  return problems;
}

bool isEqualToDense(const Problem& problem, const GmsOptions& options) {
  std::vector<Correspondence> matches = problem.matches;
  GmsFilter(options).filter(problem.reference, problem.target, matches);
  ktgp_orb::test::DenseGms dense(options);
  const auto& mask = dense.mask(problem.reference, problem.target, problem.matches);
  for (std::size_t i = 0; i < mask.size(); ++i) {
    if ((mask[i] != 0) != (matches[i].level == Level::ktg)) return false;
  }
  return true;
}

void sparse(benchmark::State& state) {
  const std::vector<Problem> problems = problemsOf(state);
  const GmsOptions options = optionsOf(state);
  if (!std::all_of(problems.begin(), problems.end(),
                   [&](const Problem& problem) { return isEqualToDense(problem, options); })) {
    state.SkipWithError("the mask differs from the dense implementation's");
    return;
  }
  GmsFilter filter(options);
  std::vector<Correspondence> matches;
  double kept = 0.0;
  std::size_t call = 0;
  for (auto _ : state) {
    const Problem& problem = problems[call++ % kProblems];
    matches = problem.matches;  // the time includes this copy of 20 bytes per match
    kept += static_cast<double>(filter.filter(problem.reference, problem.target, matches).kept);
    benchmark::DoNotOptimize(matches.data());
  }
  state.counters["kept"] = benchmark::Counter(kept, benchmark::Counter::kAvgIterations);
}

void dense(benchmark::State& state) {
  const std::vector<Problem> problems = problemsOf(state);
  ktgp_orb::test::DenseGms gms(optionsOf(state));
  double kept = 0.0;
  std::size_t call = 0;
  for (auto _ : state) {
    const Problem& problem = problems[call++ % kProblems];
    const auto& mask = gms.mask(problem.reference, problem.target, problem.matches);
    benchmark::DoNotOptimize(mask.data());
    kept += static_cast<double>(gms.kept());
  }
  state.counters["kept"] = benchmark::Counter(kept, benchmark::Counter::kAvgIterations);
}

/// The mode has bit 0 for rotation and bit 1 for scale.
void sizesAndModes(benchmark::internal::Benchmark* b) {
  b->ArgNames({"matches", "mode"})->Unit(benchmark::kMillisecond);
  for (int mode = 0; mode < 4; ++mode) {
    for (int size : {200, 500, 1000, 2000, 10000, 50000}) b->Args({size, mode});
  }
}

BENCHMARK(sparse)->Apply(sizesAndModes);
BENCHMARK(dense)->Apply(sizesAndModes);

}  // namespace

int main(int argc, char** argv) {
  return ktgp_orb::bench::run(argc, argv);
}
