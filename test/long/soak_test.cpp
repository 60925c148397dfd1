// A long run: frames as fast as the matcher processes them, together with all actions of a robot's
// operators. Nothing may grow. Run by ctest -L long.

#include <dynamic_reconfigure/Reconfigure.h>
#include <ktgp_orb/MatchPair.h>
#include <ktgp_orb/MatchStatistics.h>
#include <ktgp_orb/MatchStatus.h>
#include <sensor_msgs/CameraInfo.h>
#include <std_srvs/Trigger.h>

#include <algorithm>
#include <cstdio>
#include <optional>

#include "resources.h"
#include "robot_testing.h"

namespace ktgp_orb {
namespace {

using test::Held;

int frames = 20000;
constexpr int kCycle = 1000;  // frames per loading of the nodelet
// The memory in use hardly varies. The size of the process varies by 3 MB, depending on how its
// threads share the pages of the allocator; in 100 000 frames it does not grow after the first 10
// 000.
constexpr double kHeapLimit = 0.2;    // MB of growth
constexpr double kGrowthLimit = 4.0;  // MB of growth of the process

constexpr int kThinned = 10;  // the second robot gets every tenth frame
constexpr int kStay = 5;      // cycles per loading of the second robot

const std::string kMatcher = "/one/camera/matcher/";

/// The stamp contains the number of the frame, so that the answer can be identified.
ros::Time stampOf(int number) {
  return {1000U + static_cast<std::uint32_t>(number) / 50U,
          static_cast<std::uint32_t>(number) % 50U * 20000000U};
}

/// Sends frames one at a time and waits for the answer to each.
class Feeder {
 public:
  explicit Feeder(const std::string& camera)
      : publisher_(ros::NodeHandle().advertise<sensor_msgs::Image>(camera + "image_raw", 1)) {
    node_.setCallbackQueue(&queue_);
    subscriber_ =
        node_.subscribe<MatchStatistics>(camera + "matcher/statistics", 0,
                                         [this](const MatchStatisticsConstPtr& m) { newest_ = m; });
  }

  /// Waits until the matcher is loaded and subscribed.
  bool connected() {
    return test::waitUntil([this] {
      return publisher_.getNumSubscribers() == 1 && subscriber_.getNumPublishers() == 1;
    });
  }

  /// The answer, or null after a while; `ms`: how long it took.
  MatchStatisticsConstPtr show(const test::View& view, int number, double& ms) {
    const sensor_msgs::ImagePtr image = view.image(number, stampOf(number));
    const ros::Time stamp = image->header.stamp;
    const auto begin = std::chrono::steady_clock::now();
    publisher_.publish(image);
    const auto end = begin + std::chrono::duration<double>(test::kTimeout);
    while (!newest_ || newest_->header.stamp != stamp) {
      queue_.callAvailable(ros::WallDuration(0.05));
      if (std::chrono::steady_clock::now() > end) return nullptr;
    }
    ms =
        std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count();
    return newest_;
  }

 private:
  ros::CallbackQueue queue_;
  ros::NodeHandle node_;
  ros::Publisher publisher_;
  ros::Subscriber subscriber_;
  MatchStatisticsConstPtr newest_;
};

bool trigger(const std::string& name) {
  std_srvs::Trigger call;
  return ros::service::call(kMatcher + name, call);
}

/// One of a few changes, in turn; the last one restores the initial state.
bool reconfigure(int turn) {
  dynamic_reconfigure::Reconfigure call;
  const auto number = [&](const char* name, double value) {
    call.request.config.doubles.emplace_back();
    call.request.config.doubles.back().name = name;
    call.request.config.doubles.back().value = value;
  };
  const auto integer = [&](const char* name, int value) {
    call.request.config.ints.emplace_back();
    call.request.config.ints.back().name = name;
    call.request.config.ints.back().value = value;
  };
  const auto word = [&](const char* name, const char* value) {
    call.request.config.strs.emplace_back();
    call.request.config.strs.back().name = name;
    call.request.config.strs.back().value = value;
  };
  switch (turn % 6) {
    case 0:
      integer("features", 1000);
      break;
    case 1:
      number("T_w", 0.75);
      break;
    case 2:
      word("reference_mode", "keyframe");
      break;
    case 3:
      word("descriptor", "teblid");
      break;
    case 4:
      integer("levels", 4);
      break;
    default:
      integer("features", 500);
      integer("levels", 8);
      number("T_w", 0.66);
      word("reference_mode", "previous");
      word("descriptor", "orb");
  }
  return ros::service::call(kMatcher + "set_parameters", call);
}

struct Tally {
  std::vector<double> ms;
  int ok = 0;
  int infos = 0, thinned = 0;
  int pairs = 0, changes = 0, pauses = 0, resets = 0, sizes = 0, loads = 0, viewers = 0;
  std::uint64_t dropped = 0;
};

void report(int frame, const Held& now, Tally& tally, double seconds) {
  std::sort(tally.ms.begin(), tally.ms.end());
  const auto at = [&](double share) {
    return tally.ms[static_cast<std::size_t>(share * static_cast<double>(tally.ms.size() - 1))];
  };
  std::printf("%9d %7.0f %9.1f %8.3f %6d %8d %8.2f %8.2f %8.2f %8llu\n", frame,
              static_cast<double>(tally.ms.size()) / seconds, now.megabytes, now.heap,
              now.descriptors, now.threads, at(0.5), at(0.99), at(1.0),
              static_cast<unsigned long long>(tally.dropped));
  std::fflush(stdout);
  tally.ms.clear();
}

/// All actions between two loadings; false if an answer did not arrive.
class Soak {
 public:
  bool run() {
    nodelet::Loader loader(false);
    Feeder feeder("/one/camera/");
    Feeder other("/two/camera/");
    int report_every = std::max(kCycle, frames / 20 / kCycle * kCycle);
    std::optional<Held> warm;
    Held last;
    auto since = std::chrono::steady_clock::now();
    std::printf("%9s %7s %9s %8s %6s %8s %8s %8s %8s %8s\n", "frames", "Hz", "MB", "heap MB",
                "files", "threads", "p50 ms", "p99 ms", "max ms", "dropped");
    for (int done = 0; done < frames; done += kCycle) {
      if (!load(loader, "one", feeder)) return false;
      if (done % (kStay * kCycle) == 0 && !load(loader, "two", other)) return false;
      ros::service::waitForService(kMatcher + "set_parameters");
      if (!reconfigure(5) || !cycle(feeder, other, done)) return false;
      last = test::held();
      megabytes_.push_back(last.megabytes);
      heap_.push_back(last.heap);
      if (warm) last = test::heldAtRest(*warm);
      if (!warm && done + kCycle >= std::min(frames / 4, 20 * kCycle)) warm = last;
      if ((done + kCycle) % report_every == 0) {
        const auto now = std::chrono::steady_clock::now();
        report(done + kCycle, last, tally_, std::chrono::duration<double>(now - since).count());
        since = now;
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
    const double growth = test::growth(megabytes_);
    const double heap = test::growth(heap_);
    std::printf(
        "from the second quarter to the last (medians) %+.3f MB in use (limit %+.1f), %+.1f MB of "
        "the process (limit %+.1f); since the first %+d files, %+d threads\n",
        heap, kHeapLimit, growth, kGrowthLimit, last.descriptors - warm->descriptors,
        last.threads - warm->threads);
    EXPECT_LT(heap, kHeapLimit);
    EXPECT_LT(growth, kGrowthLimit);
    EXPECT_LE(last.descriptors, warm->descriptors);
    EXPECT_LE(last.threads, warm->threads);
    EXPECT_EQ(tally_.dropped, 0U) << "each frame was shown after the answer to the one before";
    EXPECT_GT(tally_.ok, frames / 2);
    EXPECT_EQ(tally_.thinned, frames / kThinned);
    EXPECT_EQ(tally_.infos, frames / kCycle);
    return true;
  }

 private:
  bool load(nodelet::Loader& loader, const std::string& robot, Feeder& feeder) {
    ++tally_.loads;
    return test::loadMatcher(loader, "/" + robot + "/camera") && feeder.connected();
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
      double ms = 0.0;
      const MatchStatisticsConstPtr answer = feeder.show(view, number, ms);
      if (!answer) {
        ADD_FAILURE() << "no answer to frame " << number;
        return false;
      }
      tally_.ms.push_back(ms);
      tally_.ok += answer->status == MatchStatus::STATUS_OK ? 1 : 0;
      tally_.dropped = std::max(tally_.dropped, static_cast<std::uint64_t>(answer->dropped_frames));
    }
    return reconfigure(5);
  }

  /// A frame for the second robot, whose topic is throttled: frames are lost, none dropped.
  bool showThinned(Feeder& other, int number) {
    double ms = 0.0;
    const MatchStatisticsConstPtr answer = other.show(views_[0], number, ms);
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
    dynamic_reconfigure::Reconfigure call;
    call.request.config.bools.emplace_back();
    call.request.config.bools.back().name = "rectify";
    call.request.config.bools.back().value = on;
    EXPECT_TRUE(ros::service::call(kMatcher + "set_parameters", call));
    info_ = on ? ros::NodeHandle().advertise<sensor_msgs::CameraInfo>("/one/camera/camera_info", 1)
               : ros::Publisher();
    tally_.infos += on ? 1 : 0;
  }

  static sensor_msgs::CameraInfo calibration(const test::View& view, int number) {
    const sensor_msgs::ImagePtr image = view.image(number, stampOf(number));
    sensor_msgs::CameraInfo info;
    info.header = image->header;
    info.width = image->width;
    info.height = image->height;
    info.distortion_model = "plumb_bob";
    info.D = {-0.05, 0.01, 0.0, 0.0, 0.0};
    info.K = {300.0, 0.0, image->width / 2.0, 0.0, 300.0, image->height / 2.0, 0.0, 0.0, 1.0};
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
  std::vector<double> megabytes_, heap_;  // at the end of each cycle
  Tally tally_;
  ros::Publisher info_;
};

TEST(Soak, NothingGrows) {
  EXPECT_TRUE(Soak().run());
}

}  // namespace
}  // namespace ktgp_orb

int main(int argc, char** argv) {
  ktgp_orb::frames = ktgp_orb::test::soakFrames(argc, argv, 4 * ktgp_orb::kCycle);
  return ktgp_orb::test::runTests(argc, argv, "soak_test");
}
