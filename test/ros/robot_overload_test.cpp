// A camera ten times faster than the matcher: the results must stay fresh.

#include <ktgp_orb/MatchStatistics.h>

#include <algorithm>
#include <numeric>

#include "robot_testing.h"

namespace ktgp_orb {
namespace {

using test::Camera;
using test::Recorder;

constexpr double kOverload = 10.0;
constexpr std::size_t kFewestResults = 30;  // needed for a verdict
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr int kFeatures = 500;
#else
constexpr int kFeatures = 3000;
#endif
constexpr double kAsked = 13.0;  // images per result; more than ten, to be safe

using Statistics = std::vector<MatchStatisticsConstPtr>;

double quantile(std::vector<double> values, double share) {
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
}

/// Time from one result to the next, which is the matcher's time per frame, and the age of a result
/// in these units when it was published. On a busy machine only the ratio is meaningful: both times
/// grow together.
struct Timing {
  std::vector<double> frame_times;  // ms
  std::vector<double> latencies;    // ms
  std::vector<double> ages;         // latency / frame time
};

Timing timingOf(const Statistics& statistics) {
  Timing timing;
  for (std::size_t i = 1; i < statistics.size(); ++i) {
    const MatchStatistics& before = *statistics[i - 1];
    const MatchStatistics& s = *statistics[i];
    timing.frame_times.push_back(1e3 * (s.header.stamp - before.header.stamp).toSec() +
                                 s.latency_milliseconds - before.latency_milliseconds);
    timing.latencies.push_back(s.latency_milliseconds);
    timing.ages.push_back(s.latency_milliseconds / timing.frame_times.back());
  }
  return timing;
}

/// Keeps the camera faster than the matcher, however much CPU time each of them gets.
void load(Camera& camera, Recorder<MatchStatistics>& recorder) {
  const auto end = std::chrono::steady_clock::now() +
                   std::chrono::duration<double>(test::argument("seconds", 15.0));
  ASSERT_TRUE(test::waitUntil([&] {
    const Statistics& all = recorder.messages();
    std::vector<double> recent;
    for (std::size_t i = all.size() - std::min<std::size_t>(5, all.size()); i < all.size(); ++i) {
      recent.push_back(all[i]->total_milliseconds);
    }
    if (!recent.empty()) {
      camera.setRate(kAsked * 1e3 / *std::min_element(recent.begin(), recent.end()));
    }
    return std::chrono::steady_clock::now() > end && all.size() > kFewestResults;
  }));
}

/// After all callbacks, each image since the first matched one has a result or is counted: as
/// dropped, by ROS or by the matcher, or as the image before once more.
void expectEveryImageCounted(Camera& camera, Recorder<MatchStatistics>& recorder) {
  const ros::Time last = camera.publish()->header.stamp;
  ASSERT_TRUE(recorder.waitFor(last));
  const Statistics& all = recorder.messages();
  const std::uint64_t images = all.back()->header.seq - all.front()->header.seq + 1;
  const MatchStatistics& newest = *all.back();
  EXPECT_EQ(all.size() + newest.dropped_frames + newest.lost_frames + newest.repeated_frames,
            images);
}

TEST(Overload, LatencyStaysBelowTwoFrameTimes) {
  // Slow enough for a camera that is ten times faster.
  ros::param::set("/camera/matcher/features", kFeatures);
  ros::param::set("/camera/matcher/gms_rotation", true);
  ros::param::set("/camera/matcher/gms_scale", true);
  Camera camera("/camera/image_raw", {640, 480}, 5.0);
  nodelet::Loader loader(false);
  Recorder<MatchStatistics> recorder("/camera/matcher/statistics");
  ASSERT_TRUE(test::loadMatcher(loader, "/camera"));
  ASSERT_TRUE(test::waitUntil([&] { return camera.subscribers() > 0; }));
  camera.publish();  // alone, so that it is the first to be matched
  ASSERT_TRUE(recorder.waitForMore(1));
  camera.start();
  ASSERT_TRUE(recorder.waitForMore(8));
  const std::size_t before = recorder.messages().size();
  const int sent_before = camera.count();
  const auto start = std::chrono::steady_clock::now();
  ASSERT_NO_FATAL_FAILURE(load(camera, recorder));
  const Statistics statistics(recorder.messages().begin() + std::ptrdiff_t(before),
                              recorder.messages().end());
  const double sent = camera.count() - sent_before;
  const double elapsed =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  camera.stop();

  const double overload = sent / static_cast<double>(statistics.size());
  const Timing timing = timingOf(statistics);
  const auto quarter = static_cast<std::ptrdiff_t>(timing.ages.size() / 4);
  const double first = quantile({timing.ages.begin(), timing.ages.begin() + quarter}, 0.5);
  const double last = quantile({timing.ages.end() - quarter, timing.ages.end()}, 0.5);
  const double late = static_cast<double>(std::count_if(timing.ages.begin(), timing.ages.end(),
                                                        [](double age) { return age >= 2.0; })) /
                      static_cast<double>(timing.ages.size());
  std::printf(
      "%.0f s: camera %.0f/s, matcher %.1f/s (%.1fx overload), frame time %.1f ms; latency: median "
      "%.1f ms, maximum %.1f ms; in frame times: median %.2f (first quarter %.2f, last %.2f), "
      "99 %% %.2f; above 2: %.1f %%\n",
      elapsed, sent / elapsed, static_cast<double>(statistics.size()) / elapsed, overload,
      quantile(timing.frame_times, 0.5), quantile(timing.latencies, 0.5),
      quantile(timing.latencies, 1.0), quantile(timing.ages, 0.5), first, last,
      quantile(timing.ages, 0.99), 100.0 * late);

  EXPECT_GE(overload, kOverload) << "the camera was not fast enough for the test to mean anything";
  EXPECT_LT(quantile(timing.ages, 0.5), 1.5);
  EXPECT_LE(late, 0.02) << "results older than two frame times";
  EXPECT_LT(last, 1.3 * first) << "the latency grows";
  expectEveryImageCounted(camera, recorder);
}

}  // namespace
}  // namespace ktgp_orb
