// Loading, unloading and sharing of images in one manager.

#include <ktgp_orb/MatchStatistics.h>

#include <fstream>

#include "robot_testing.h"

namespace ktgp_orb {
namespace {

using test::Camera;
using test::Recorder;
using test::waitUntil;

double residentMegabytes() {
  std::ifstream statm("/proc/self/statm");
  double size = 0.0;
  double resident = 0.0;
  statm >> size >> resident;
  return resident * 4096.0 / 1e6;
}

TEST(Loading, CyclesUnderTrafficLeakNothingAndFallSilent) {
  Camera camera("/camera/image_raw", {320, 240}, 100.0);
  nodelet::Loader loader(false);
  Recorder<MatchStatistics> statistics("/camera/matcher/statistics");
  camera.start();
  const int cycles = test::argument("cycles", 200);
  double settled = 0.0;
  for (int cycle = 0; cycle < cycles; ++cycle) {
    ASSERT_TRUE(test::loadMatcher(loader, "/camera")) << "cycle " << cycle;
    ASSERT_TRUE(statistics.waitForMore(1)) << "cycle " << cycle;
    ASSERT_TRUE(loader.unload("/camera/matcher"));
    const std::size_t until_unload = statistics.messages().size();
    ASSERT_EQ(camera.subscribers(), 0U);
    const int sent = camera.count();
    ASSERT_TRUE(waitUntil([&] { return camera.count() > sent + 2; }));
    ASSERT_EQ(statistics.messages().size(), until_unload) << "a message after the unloading";
    statistics.clear();
    if (cycle == cycles / 4) settled = residentMegabytes();
  }
  const double growth = residentMegabytes() - settled;
  std::cout << "resident memory grew by " << growth << " MB from cycle " << cycles / 4 << " to "
            << cycles << " (" << settled << " MB)\n";
  RecordProperty("growth_megabytes", std::to_string(growth));
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
  // One image takes 0.08 MB, a matcher 3 MB.
  EXPECT_LT(growth, 0.05 * (cycles - cycles / 4));
#endif
}

TEST(Loading, FailedStartDoesNotHarmTheManager) {
  nodelet::Loader loader(false);
  for (int cycle = 0; cycle < 5; ++cycle) {
    ros::param::set("/camera/matcher/reference_image", "/no/such/file.png");
    EXPECT_FALSE(test::loadMatcher(loader, "/camera"));
    ros::param::set("/camera/matcher/reference_image", "");
    EXPECT_TRUE(test::loadMatcher(loader, "/camera"));
    EXPECT_TRUE(loader.unload("/camera/matcher"));
  }
}

// ROS may connect a publisher and a subscriber of one process twice if both start at once.
TEST(Loading, AnImageDeliveredTwiceIsMatchedOnce) {
  Camera camera("/camera/image_raw", {320, 240}, 1.0);
  nodelet::Loader loader(false);
  Recorder<MatchStatistics> statistics("/camera/matcher/statistics");
  ASSERT_TRUE(test::loadMatcher(loader, "/camera"));
  ASSERT_TRUE(waitUntil([&] { return camera.subscribers() > 0; }));
  for (int i = 1; i <= 5; ++i) {
    camera.publishAgain(camera.publish());
    ASSERT_TRUE(waitUntil([&] { return statistics.messages().size() >= std::size_t(i); }));
  }
  ASSERT_EQ(statistics.messages().size(), 5U);
  for (const auto& s : statistics.messages()) EXPECT_NE(s->header.stamp, s->reference_stamp);
}

// A matcher holds the image of its reference. If that is the object that the camera published, and
// not a copy, the camera can count the holders.
void expectSharedBy(int matchers) {
  Camera camera("/camera_0/image_raw", {320, 240}, 100.0);
  nodelet::Loader loader(false);
  std::vector<std::unique_ptr<Recorder<MatchStatistics>>> statistics;
  for (int i = 0; i < matchers; ++i) {
    const std::string name = "/camera_" + std::to_string(i);
    statistics.push_back(std::make_unique<Recorder<MatchStatistics>>(name + "/matcher/statistics"));
    ASSERT_TRUE(loader.load(name + "/matcher", "ktgp_orb/matcher",
                            {{name + "/image", "/camera_0/image_raw"}}, {}));
  }
  // The publisher sees one subscriber per process: wait for the first frame of each matcher.
  for (auto& recorder : statistics) {
    ASSERT_TRUE(waitUntil([&] {
      if (recorder->messages().empty()) camera.publish();
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
      return !recorder->messages().empty();
    }));
  }
  const sensor_msgs::ImageConstPtr image = camera.publish();
  for (auto& recorder : statistics) {
    ASSERT_TRUE(recorder->waitFor(image->header.stamp));
  }
  EXPECT_TRUE(waitUntil([&] { return image.use_count() == 1 + matchers; }))
      << image.use_count() << " holders of the image; expected the camera and " << matchers;
  loader.clear();
  EXPECT_EQ(image.use_count(), 1) << "someone still holds the image after the unloading";
}

TEST(ZeroCopy, TwoMatchersHoldTheCamerasOwnImage) {
  expectSharedBy(2);
}

TEST(ZeroCopy, EightMatchersHoldTheCamerasOwnImage) {
  expectSharedBy(8);
}

}  // namespace
}  // namespace ktgp_orb
