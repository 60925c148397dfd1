// Measures a whole frame: extraction, nearest neighbours, ratio test, GMS and homography. The peer
// is the same chain from OpenCV's parts: cv::ORB, cv::BFMatcher, the ratio test and
// cv::findHomography with USAC_PROSAC. OpenCV's GMS is in opencv_contrib, which distributions leave
// out, so a dense implementation replaces it. Our time includes GMS and OpenCV's time does not.
// 640x480, 2000 features; every frame is matched to the previous frame.
//
//   ms           median of a frame: CPU time for one thread, wall-clock time for more
//   times_OpenCV how many times as fast as OpenCV's chain without GMS on as many threads, medians
//                of frames that alternate
//   KT KTG KTGP  matches after the stages, of the last frame
//   fall_backs   frames whose search within the radius (px, 0: the whole image) failed
//
// The rows of `preset` measure our chain alone, with alignment and with the presets, on one thread:
//
//   ms           median CPU time of a frame
//   ktgp_ms      median CPU time of KTGP alone, on alternating frames
//   matches      final matches of the last frame
//
// The frames are two images of the Leuven set in KTGP_ORB_DATA, scaled, in turn.

#include <benchmark/benchmark.h>

#include <algorithm>
#include <opencv2/calib3d.hpp>
#include <opencv2/core.hpp>
#include <opencv2/features2d.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <utility>
#include <vector>

#include "dense_gms.h"
#include "files/input.h"
#include "ktgp_orb/metrics.h"
#include "ktgp_orb/sequence_matcher.h"
#include "main.h"
#include "support.h"

namespace {

using ktgp_orb::Correspondence;
using ktgp_orb::Features;
using ktgp_orb::GmsOptions;
using ktgp_orb::Level;
using ktgp_orb::SequenceOptions;
using ktgp_orb::bench::milliseconds;

std::vector<cv::Mat> readFrames() {
  std::vector<cv::Mat> frames;
  const auto folder = ktgp_orb::bench::oxfordFolder();
  for (int number : {1, 2}) {
    if (!folder) break;
    cv::Mat image =
        ktgp_orb::files::readGrey(ktgp_orb::bench::oxfordImage(*folder, "leuven", number));
    cv::resize(image, image, cv::Size(640, 480), 0, 0, cv::INTER_AREA);
    frames.push_back(image);
  }
  return frames;
}

GmsOptions gmsOptions(bool turned) {
  GmsOptions options;
  options.rotation = options.scale = turned;
  return options;
}

SequenceOptions optionsOf(bool turned, double radius, int threads) {
  SequenceOptions options;
  options.orb.threads = threads;
  options.matcher.knn.threads = threads;
  options.matcher.knn.search_radius = radius;
  options.matcher.gms = gmsOptions(turned);
  return options;
}

class OurChain {
 public:
  explicit OurChain(const SequenceOptions& options) : matcher_(options) {}

  void process(const cv::Mat& image) {
    match_ = &matcher_.match(image, 0.033 * static_cast<double>(frames_++));
  }

  double surviving(Level level) const {
    return static_cast<double>(countAtLeast(match_->match.correspondences, level));
  }
  double fallBacks() const { return static_cast<double>(match_->fall_backs); }

  std::size_t matches() const { return match_->match.inliers; }

 private:
  ktgp_orb::SequenceMatcher matcher_;
  const ktgp_orb::SequenceMatch* match_ = nullptr;
  std::size_t frames_ = 0;
};

class OpencvChain {
 public:
  explicit OpencvChain(bool turned) : gms_(gmsOptions(turned)) {}

  /// Returns the time of the chain without GMS.
  double process(const cv::Mat& image, bool one_thread) {
    const double start = milliseconds(one_thread);
    std::swap(reference_, target_);
    target_.image_size = image.size();
    orb_->detectAndCompute(image, cv::noArray(), target_.keypoints, target_.descriptors);
    if (reference_.empty()) return 0.0;
    matcher_.knnMatch(target_.descriptors, reference_.descriptors, nearest_, 2);
    testRatio();
    const double gms_start = milliseconds(one_thread);
    keepMotion();
    const double gms_end = milliseconds(one_thread);
    estimateHomography();
    return milliseconds(one_thread) - gms_end + gms_start - start;
  }

 private:
  void testRatio() {
    matches_.clear();
    for (const auto& two : nearest_) {
      if (two.size() < 2 || two[0].distance >= ktgp_orb::kDefaultRatioThreshold * two[1].distance)
        continue;
      Correspondence match;
      match.reference_index = two[0].trainIdx;
      match.target_index = two[0].queryIdx;
      match.distance = static_cast<std::int32_t>(two[0].distance);
      match.second_distance = static_cast<std::int32_t>(two[1].distance);
      matches_.push_back(match);
    }
  }

  void keepMotion() {
    const auto& mask = gms_.mask(reference_, target_, matches_);
    std::size_t kept = 0;
    for (std::size_t i = 0; i < matches_.size(); ++i) {
      if (mask[i] != 0) matches_[kept++] = matches_[i];
    }
    matches_.resize(kept);
  }

  // USAC_PROSAC needs the best pairs first, and reads out of bounds for fewer than 100 pairs.
  void estimateHomography() {
    if (matches_.size() < 100) return;
    std::stable_sort(
        matches_.begin(), matches_.end(),
        [](const Correspondence& a, const Correspondence& b) { return a.ratio() < b.ratio(); });
    from_.clear();
    to_.clear();
    for (const Correspondence& match : matches_) {
      from_.push_back(reference_.keypoints[match.reference_index].pt);
      to_.push_back(target_.keypoints[match.target_index].pt);
    }
    benchmark::DoNotOptimize(
        cv::findHomography(from_, to_, cv::USAC_PROSAC, 3.0, inliers_, 2000, 0.995));
  }

  cv::Ptr<cv::ORB> orb_ = cv::ORB::create(2000);
  cv::BFMatcher matcher_{cv::NORM_HAMMING};
  ktgp_orb::test::DenseGms gms_;
  Features reference_, target_;
  std::vector<std::vector<cv::DMatch>> nearest_;
  std::vector<Correspondence> matches_;
  std::vector<cv::Point2f> from_, to_;
  cv::Mat inliers_;
};

void frame(benchmark::State& state) {
  const std::vector<cv::Mat> frames = readFrames();
  if (frames.empty()) {
    state.SkipWithError("KTGP_ORB_DATA is not set or holds no oxford/leuven");
    return;
  }
  const bool turned = state.range(0) != 0;
  const auto radius = static_cast<double>(state.range(1));
  const auto threads = static_cast<int>(state.range(2));
  const bool one_thread = threads == 1;
  cv::setNumThreads(threads);
  OurChain ours(optionsOf(turned, radius, threads));
  OpencvChain opencv(turned);
  for (std::size_t i = 0; i < 4; ++i) ours.process(frames[i % 2]);  // buffers grow
  opencv.process(frames[1], one_thread);
  std::vector<double> times;
  std::vector<double> opencv_times;
  std::size_t i = 0;
  for (auto _ : state) {
    const cv::Mat& image = frames[i++ % 2];
    const double start = milliseconds(one_thread);
    ours.process(image);
    times.push_back(milliseconds(one_thread) - start);
    if (opencv_times.size() == 31) continue;
    state.PauseTiming();
    opencv_times.push_back(opencv.process(image, one_thread));
    state.ResumeTiming();
  }
  const double time = ktgp_orb::metrics::median(times);
  state.counters["ms"] = time;
  state.counters["times_OpenCV"] = ktgp_orb::metrics::median(opencv_times) / time;
  state.counters["KT"] = ours.surviving(Level::kt);
  state.counters["KTG"] = ours.surviving(Level::ktg);
  state.counters["KTGP"] = ours.surviving(Level::ktgp);
  state.counters["fall_backs"] = ours.fallBacks();
}

SequenceOptions presetOf(const ktgp_orb::MatcherOptions& matcher) {
  SequenceOptions options;
  options.matcher = matcher;
  return options;
}

SequenceOptions ktgpAlone() {
  SequenceOptions options = presetOf({});
  options.matcher.alignment.enabled = false;
  return options;
}

SequenceOptions robustWithTeblid() {
  SequenceOptions options = presetOf(ktgp_orb::MatcherOptions::robust());
  options.orb.descriptor = ktgp_orb::DescriptorKind::teblid;
  return options;
}

void preset(benchmark::State& state, const SequenceOptions& options) {
  const std::vector<cv::Mat> frames = readFrames();
  if (frames.empty()) {
    state.SkipWithError("KTGP_ORB_DATA is not set or holds no oxford/leuven");
    return;
  }
  OurChain chain(options);
  OurChain ktgp(ktgpAlone());
  std::vector<double> times;
  std::vector<double> ktgp_times;
  std::size_t i = 0;
  const auto timed = [&](OurChain& one) {
    const double start = milliseconds(true);
    one.process(frames[i % 2]);
    return milliseconds(true) - start;
  };
  for (; i < 4; ++i) {  // buffers grow
    timed(chain);
    timed(ktgp);
  }
  for (auto _ : state) {
    times.push_back(timed(chain));
    state.PauseTiming();
    ktgp_times.push_back(timed(ktgp));
    ++i;
    state.ResumeTiming();
  }
  state.counters["ms"] = ktgp_orb::metrics::median(times);
  state.counters["ktgp_ms"] = ktgp_orb::metrics::median(ktgp_times);
  state.counters["matches"] = static_cast<double>(chain.matches());
}

BENCHMARK_CAPTURE(preset, ktgp_alone, ktgpAlone())->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(preset, ktgp, presetOf(ktgp_orb::MatcherOptions::ktgp()))
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(preset, robust, presetOf(ktgp_orb::MatcherOptions::robust()))
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(preset, robust_teblid, robustWithTeblid())->Unit(benchmark::kMillisecond);

BENCHMARK(frame)
    ->ArgNames({"rotation_and_scale", "radius", "threads"})
    ->ArgsProduct({{0, 1}, {0, 48}, {1, 2}})
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

}  // namespace

int main(int argc, char** argv) {
  return ktgp_orb::bench::run(argc, argv);
}
