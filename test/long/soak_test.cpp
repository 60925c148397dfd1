// A long run: frames as fast as the matcher processes them, together with all actions of a robot's
// operators. Nothing may grow. Run by ctest -L long.

#include <ktgp_orb/MatchPair.h>
#include <ktgp_orb/MatchStatistics.h>
#include <ktgp_orb/MatchStatus.h>
#include <std_srvs/Trigger.h>

#include <algorithm>
#include <cstdio>

#include "resources.h"
#include "robot_testing.h"

namespace ktgp_orb {
namespace {

using test::Held;

constexpr int kCycle = 1000;  // frames per loading of the nodelet
// The memory in use hardly varies. The size of the process varies by 3 MB, depending on how its
// threads share the pages of the allocator; in 100 000 frames it does not grow after the first 10
// 000.
constexpr double kHeapLimit = 0.2;    // MB of growth
constexpr double kGrowthLimit = 4.0;  // MB of growth of the process

constexpr int kThinned = 10;  // the second robot gets every tenth frame
constexpr int kStay = 5;      // cycles per loading of the second robot

const std::string kMatcher = "/one/camera/matcher/";

using Feeder = test::Feeder<MatchStatistics>;

bool trigger(const std::string& name) {
  std_srvs::Trigger call;
  return ros::service::call(kMatcher + name, call);
}

/// One of a few changes, in turn; the last one restores the initial state.
bool reconfigure(int turn) {
  test::Change change;
  switch (turn % 6) {
    case 0:
      change.set("features", 1000);
      break;
    case 1:
      change.set("T_w", 0.75);
      break;
    case 2:
      change.set("reference_mode", std::string("keyframe"));
      break;
    case 3:
      change.set("descriptor", std::string("teblid"));
      break;
    case 4:
      change.set("levels", 4);
      break;
    default:
      change.set("features", 500).set("levels", 8).set("T_w", 0.66);
      change.set("reference_mode", std::string("previous"));
      change.set("descriptor", std::string("orb"));
  }
  return change.send("/one/camera/matcher");
}

struct Tally {
  int ok = 0;
  int infos = 0, thinned = 0;
  int pairs = 0, changes = 0, pauses = 0, resets = 0, sizes = 0, loads = 0, viewers = 0;
  std::uint64_t dropped = 0;
};

void report(int frame, const Held& now, std::uint64_t dropped, const Feeder::Times& times,
            double seconds) {
  std::printf("%9d %7.0f %9.1f %8.3f %6d %8d %8.2f %8.2f %8.2f %8llu\n", frame,
              times.count / seconds, now.megabytes, now.heap, now.descriptors, now.threads,
              times.p50, times.p99, times.max, static_cast<unsigned long long>(dropped));
  std::fflush(stdout);
}

/// All actions between two loadings; false if an answer did not arrive.
class Soak {
 public:
  bool run() {
    nodelet::Loader loader(false);
    Feeder feeder("/one/camera/", kMatcher + "statistics");
    Feeder other("/two/camera/", "/two/camera/matcher/statistics");
    int report_every = std::max(kCycle, frames_ / 20 / kCycle * kCycle);
    auto since = std::chrono::steady_clock::now();
    std::printf("%9s %7s %9s %8s %6s %8s %8s %8s %8s %8s\n", "frames", "Hz", "MB", "heap MB",
                "files", "threads", "p50 ms", "p99 ms", "max ms", "dropped");
    for (int done = 0; done < frames_; done += kCycle) {
      if (!load(loader, "one", feeder)) return false;
      if (done % (kStay * kCycle) == 0 && !load(loader, "two", other)) return false;
      ros::service::waitForService(kMatcher + "set_parameters");
      if (!reconfigure(5) || !cycle(feeder, other, done)) return false;
      const Held& now = course_.add(done + kCycle >= std::min(frames_ / 4, 20 * kCycle));
      if ((done + kCycle) % report_every == 0) {
        const auto end = std::chrono::steady_clock::now();
        report(done + kCycle, now, tally_.dropped, feeder.times(),
               std::chrono::duration<double>(end - since).count());
        since = end;
      }
      if (!loader.unload("/one/camera/matcher")) return false;
      if ((done / kCycle + 1) % kStay == 0 && !loader.unload("/two/camera/matcher")) return false;
    }
    std::printf(
        "%d loads, %d changes of parameters, %d viewers, %d pairs, %d pauses, %d resets, "
        "%d changes of size, %d times camera_info came; %d frames ok; the other robot saw %d "
        "frames of a "
        "thinned topic\n",
        tally_.loads, tally_.changes, tally_.viewers, tally_.pairs, tally_.pauses, tally_.resets,
        tally_.sizes, tally_.infos, tally_.ok, tally_.thinned);
    course_.judge(kHeapLimit, kGrowthLimit);
    EXPECT_EQ(tally_.dropped, 0U) << "each frame was shown after the answer to the one before";
    EXPECT_GT(tally_.ok, frames_ / 2);
    EXPECT_EQ(tally_.thinned, frames_ / kThinned);
    EXPECT_EQ(tally_.infos, frames_ / kCycle);
    return true;
  }

 private:
  bool load(nodelet::Loader& loader, const std::string& robot, Feeder& feeder) {
    ++tally_.loads;
    return test::loadMatcher(loader, "/" + robot + "/camera") && feeder.connect();
  }

  bool cycle(Feeder& feeder, Feeder& other, int first) {
    std::unique_ptr<test::Recorder<sensor_msgs::Image>> viewer;
    for (int i = 0; i < kCycle; ++i) {
      const int number = first + i;
      if (i % 300 == 0) ++tally_.sizes;
      const test::View& view = views_[static_cast<std::size_t>(i / 300 % 3)];
      if (i % 50 == 20) {
        tally_.changes += reconfigure(i / 50) ? 1 : 0;
      }
      if (i % 100 == 30) {
        viewer = std::make_unique<test::Recorder<sensor_msgs::Image>>(kMatcher + "matches_image");
        ++tally_.viewers;
      }
      if (viewer) {
        viewer->messages();
        viewer->clear();
      }
      if (i % 100 == 45) viewer.reset();
      if (i % 250 == 60 && !pair(view, number)) return false;
      if (i % 250 == 100) tally_.resets += trigger("reset") ? 1 : 0;
      if (i % 500 == 200) {
        tally_.pauses += trigger("pause") ? 1 : 0;
        if (!trigger("resume")) return false;
      }
      if (i == 650) rectify(true);
      if (i == 750) rectify(false);
      if (info_) info_.publish(calibration(view, number));
      if (number % kThinned == 0 && !showThinned(other, number)) return false;
      const auto answer = feeder.show(view.image(number, test::stampOf(number)));
      if (!answer) {
        ADD_FAILURE() << "no answer to frame " << number;
        return false;
      }
      tally_.ok += answer->status == MatchStatus::STATUS_OK ? 1 : 0;
      tally_.dropped = std::max(tally_.dropped, static_cast<std::uint64_t>(answer->dropped_frames));
    }
    return reconfigure(5);
  }

  /// A frame for the second robot, whose topic is throttled: frames are lost, none dropped.
  bool showThinned(Feeder& other, int number) {
    const auto answer = other.show(views_[0].image(number, test::stampOf(number)));
    if (!answer) {
      ADD_FAILURE() << "the second robot has no answer to frame " << number;
      return false;
    }
    ++tally_.thinned;
    EXPECT_EQ(answer->dropped_frames, 0U);
    return true;
  }

  /// Switches camera_info on or off.
  void rectify(bool on) {
    EXPECT_TRUE(test::Change().set("rectify", on).send("/one/camera/matcher"));
    info_ = on ? ros::NodeHandle().advertise<sensor_msgs::CameraInfo>("/one/camera/camera_info", 1)
               : ros::Publisher();
    tally_.infos += on ? 1 : 0;
  }

  static sensor_msgs::CameraInfo calibration(const test::View& view, int number) {
    const sensor_msgs::ImagePtr image = view.image(number, test::stampOf(number));
    const cv::Size size(static_cast<int>(image->width), static_cast<int>(image->height));
    sensor_msgs::CameraInfo info = test::calibration(size, 300.0, -0.05);
    info.header = image->header;
    return info;
  }

  bool pair(const test::View& view, int number) {
    MatchPair call;
    call.request.reference = *view.image(number, ros::Time(1));
    call.request.target = *view.image(number + 1, ros::Time(2));
    ++tally_.pairs;
    return ros::service::call(kMatcher + "match_pair", call);
  }

  const test::View views_[3]{test::View({320, 240}), test::View({400, 240}),
                             test::View({256, 256})};
  const int frames_ = test::soakFrames(4 * kCycle);
  test::Course course_;
  Tally tally_;
  ros::Publisher info_;
};

TEST(Soak, NothingGrows) {
  EXPECT_TRUE(Soak().run());
}

}  // namespace
}  // namespace ktgp_orb
