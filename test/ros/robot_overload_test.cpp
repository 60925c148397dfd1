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
constexpr std::size_t kFewestResults = 30;  // to judge by
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
constexpr int kFeatures = 500;
#else
constexpr int kFeatures = 3000;
#endif
double seconds = 15.0;

using Statistics = std::vector<MatchStatisticsConstPtr>;

double quantile(std::vector<double> values, double share) {
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1))];
}

/// Time from one result to the next, which is the matcher's time for a frame, and how many of them
/// old the result was when it was published. Only the ratio tells on a machine that is busy
/// elsewhere: both times stretch together.
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

TEST(Overload, LatencyStaysBelowTwoFrameTimes) {
  // Slow enough that a camera can be ten times faster.
  ros::param::set("/camera/matcher/features", kFeatures);
  ros::param::set("/camera/matcher/gms_rotation", true);
  ros::param::set("/camera/matcher/gms_scale", true);
  Camera camera("/camera/image_raw", {640, 480}, 5.0);
  nodelet::Loader loader(false);
  Recorder<MatchStatistics> recorder("/camera/matcher/statistics");
  ASSERT_TRUE(test::loadMatcher(loader, "/camera"));
  camera.start();
  ASSERT_TRUE(recorder.waitForMore(8));
  std::vector<double> totals;
  for (const auto& s : recorder.messages()) totals.push_back(s->total_milliseconds);
  const double rate = kOverload * 1e3 / quantile(totals, 0.5);
  camera.setRate(rate);
  ASSERT_TRUE(recorder.waitForMore(5));
  recorder.clear();

  const int sent_before = camera.count();
  const auto start = std::chrono::steady_clock::now();
  std::this_thread::sleep_for(std::chrono::duration<double>(seconds));  // the load, not a wait
  ASSERT_TRUE(test::waitUntil([&] { return recorder.messages().size() > kFewestResults; }));
  const Statistics statistics = recorder.messages();
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

  EXPECT_GT(overload, 4.0) << "the camera was not fast enough for the test to mean anything";
  EXPECT_LT(quantile(timing.ages, 0.5), 1.5);
  EXPECT_LE(late, 0.02) << "results older than two frame times";
  EXPECT_LT(last, 1.3 * first) << "the latency grows";
  const MatchStatistics& end = *statistics.back();
  // Those that ROS itself drops, before the callback, nobody can count.
  const auto dropped = static_cast<double>(end.dropped_frames - statistics.front()->dropped_frames);
  EXPECT_GT(dropped, static_cast<double>(statistics.size()));
  EXPECT_LE(dropped, sent);
}

}  // namespace
}  // namespace ktgp_orb

int main(int argc, char** argv) {
  ktgp_orb::seconds = ktgp_orb::test::argument(argc, argv, "seconds", 15.0);
  return ktgp_orb::test::runTests(argc, argv, "robot_overload_test");
}
