// Measures the stages after the homography on one thread, 640x480, 2000 features: sub-pixel
// alignment of up to N points, and a round of guided matching. Peers are OpenCV's pyramidal
// Lucas-Kanade for as many points, started at the predictions of the homography, and OpenCV's ECC
// over the whole image, started at the homography. All run in one process on the same pair.
//
//   ms        median CPU time of a call
//   error_px  mean distance of the image's corners from their true places, afterwards
//   before_px this distance for the initial homography of all methods
//   points    number of points that were aligned, followed or matched
//
// The pair is an exact warp of the first image of the Leuven set in KTGP_ORB_DATA, with noise, blur
// and a change of light (a pair of `ktgp_evaluate --warps`). Arguments of a name: N, and the size
// of the warp (0 small, 1 medium, 2 large). The points of Lucas-Kanade get the same fit as ours.

#include <benchmark/benchmark.h>

#include <Eigen/Core>
#include <algorithm>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <opencv2/core/eigen.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/video/tracking.hpp>
#include <string>
#include <vector>

#include "evaluation/warps.h"
#include "homography/fit.h"
#include "ktgp_orb/ktgp_matcher.h"
#include "ktgp_orb/metrics.h"
#include "ktgp_orb/orb_extractor.h"
#include "main.h"
#include "support.h"

namespace {

using ktgp_orb::Features;
using ktgp_orb::Level;
using ktgp_orb::MatcherOptions;
using ktgp_orb::MatchResult;
using ktgp_orb::bench::milliseconds;

/// A pair of views with features, and its homography before any of the measured stages.
struct Pair {
  ktgp_orb::evaluation::WarpedImages images;
  Eigen::Matrix3d truth = Eigen::Matrix3d::Identity();
  Features reference, target;
  MatchResult match;
  std::vector<ktgp_orb::Correspondence> inliers;

  explicit Pair(int size) {
    const auto folder = ktgp_orb::bench::oxfordFolder();
    if (!folder) return;
    const cv::Mat picture =
        cv::imread(ktgp_orb::bench::oxfordImage(*folder, "leuven", 1), cv::IMREAD_GRAYSCALE);
    if (picture.empty()) return;
    const char* const names[] = {"small", "medium", "large"};
    const auto warp =
        ktgp_orb::evaluation::drawWarp(*ktgp_orb::evaluation::warpLimits(names[size]), 3, 1);
    truth = warp.homography;
    images = renderWarp(picture, warp);
    ktgp_orb::OrbExtractor extractor;
    extractor.extract(images.reference, reference);
    extractor.extract(images.target, target);
    MatcherOptions options = MatcherOptions::robust();
    options.guided.enabled = options.alignment.enabled = false;
    ktgp_orb::KtgpMatcher(options).match(reference, target, match);
    match.surviving(Level::ktgp, inliers);
  }

  /// Reports to `state` if there is no data.
  bool isUsable(benchmark::State& state) const {
    if (match.status == ktgp_orb::Status::ok) return true;
    state.SkipWithError("KTGP_ORB_DATA is not set or holds no oxford/leuven");
    return false;
  }

  ktgp_orb::UncertainHomography answer() const {
    return {match.answer.homography, match.answer.covariance, match.answer.shared_covariance,
            match.answer.plane_deviation};
  }

  double error(const Eigen::Matrix3d& h) const {
    return ktgp_orb::metrics::cornerError(h, truth, reference.image_size);
  }
};

/// Times `call`, which returns the number of its points.
template <typename Call>
void run(benchmark::State& state, const Pair& pair, const Eigen::Matrix3d& homography, Call call) {
  std::size_t points = call();  // buffers grow
  std::vector<double> times;
  for (auto _ : state) {
    const double start = milliseconds(true);
    points = call();
    times.push_back(milliseconds(true) - start);
  }
  state.counters["ms"] = ktgp_orb::metrics::median(times);
  state.counters["error_px"] = pair.error(homography);
  state.counters["before_px"] = pair.error(pair.match.answer.homography);
  state.counters["points"] = static_cast<double>(points);
}

void align(benchmark::State& state) {
  const Pair pair(static_cast<int>(state.range(1)));
  if (!pair.isUsable(state)) return;
  ktgp_orb::AlignmentOptions options;
  options.points = static_cast<int>(state.range(0));
  ktgp_orb::Alignment alignment(options);
  ktgp_orb::AlignmentResult result;
  const ktgp_orb::UncertainHomography start = pair.answer();
  alignment.align(pair.reference, pair.target, pair.inliers, start, result);
  run(state, pair, result.answer.homography, [&] {
    alignment.align(pair.reference, pair.target, pair.inliers, start, result);
    return result.points.size();
  });
}

/// Patches of Lucas-Kanade do not adapt to rotation and zoom. The fit is ours and is not timed.
void lucasKanade(benchmark::State& state) {
  const Pair pair(static_cast<int>(state.range(1)));
  if (!pair.isUsable(state)) return;
  std::vector<cv::Point2f> from;
  for (const auto& c : pair.inliers) {
    if (from.size() == static_cast<std::size_t>(state.range(0))) break;
    from.push_back(pair.reference.keypoints[static_cast<std::size_t>(c.reference_index)].pt);
  }
  cv::Mat h;
  cv::eigen2cv(pair.match.answer.homography, h);
  std::vector<cv::Point2f> predicted, to;
  cv::perspectiveTransform(from, predicted, h);
  std::vector<std::uint8_t> followed;
  cv::setNumThreads(1);
  const auto track = [&] {
    to = predicted;
    cv::calcOpticalFlowPyrLK(
        pair.images.reference, pair.images.target, from, to, followed, cv::noArray(), {21, 21}, 3,
        {cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 30, 0.01}, cv::OPTFLOW_USE_INITIAL_FLOW);
    return static_cast<std::size_t>(std::count(followed.begin(), followed.end(), 1));
  };
  track();
  std::vector<Eigen::Vector2d> reference_points, target_points;
  for (std::size_t i = 0; i < to.size(); ++i) {
    if (followed[i] == 0) continue;
    reference_points.emplace_back(from[i].x, from[i].y);
    target_points.emplace_back(to[i].x, to[i].y);
  }
  ktgp_orb::UncertainHomography estimate = pair.answer();
  ktgp_orb::homography::EvidenceOptions evidence;
  evidence.min_scale = 1.0;  // as in the alignment
  ktgp_orb::homography::HomographyRefiner().refine(reference_points, target_points,
                                                   pair.reference.image_size, evidence, estimate);
  run(state, pair, estimate.homography, track);
}

void ecc(benchmark::State& state) {
  const Pair pair(static_cast<int>(state.range(1)));
  if (!pair.isUsable(state)) return;
  cv::setNumThreads(1);
  cv::Mat h;
  const auto maximise = [&] {
    cv::eigen2cv(Eigen::Matrix3f(pair.match.answer.homography.cast<float>()), h);
    cv::findTransformECC(pair.images.reference, pair.images.target, h, cv::MOTION_HOMOGRAPHY,
                         {cv::TermCriteria::COUNT | cv::TermCriteria::EPS, 50, 1e-4});
    return std::size_t{0};
  };
  maximise();
  Eigen::Matrix3f homography;
  cv::cv2eigen(h, homography);
  run(state, pair, homography.cast<double>(), maximise);
}

void guided(benchmark::State& state) {
  const Pair pair(static_cast<int>(state.range(1)));
  if (!pair.isUsable(state)) return;
  ktgp_orb::GuidedMatcher matcher(MatcherOptions::robust().guided);
  ktgp_orb::UncertainHomography estimate;
  std::vector<ktgp_orb::Correspondence> matches;
  const auto round = [&] {
    estimate = pair.answer();
    matcher.refine(pair.reference, pair.target, 3.0, false, estimate, matches);
    return matches.size();
  };
  round();
  run(state, pair, estimate.homography, round);
}

void arguments(benchmark::internal::Benchmark* benchmark) {
  benchmark->ArgNames({"points", "warp"})->Unit(benchmark::kMillisecond);
}

BENCHMARK(align)
    ->Apply(arguments)
    ->ArgsProduct({{400}, {0, 1, 2}})
    ->Args({100, 0})
    ->Args({1000, 0});
BENCHMARK(lucasKanade)->Apply(arguments)->ArgsProduct({{400}, {0, 1, 2}});
BENCHMARK(ecc)->Apply(arguments)->ArgsProduct({{0}, {0, 1}})->Iterations(5);
BENCHMARK(guided)->Apply(arguments)->ArgsProduct({{2000}, {0, 1, 2}});

}  // namespace

int main(int argc, char** argv) {
  return ktgp_orb::bench::run(argc, argv);
}
