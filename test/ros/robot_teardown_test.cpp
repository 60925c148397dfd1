// Unloading in the middle of everything: parameters (fast, and slow ones that read a large file),
// services, pairs to match, images, and subscribers that come and go. Nothing may crash, hang or
// leave behind what was not set.

#include <dynamic_reconfigure/Reconfigure.h>
#include <ktgp_orb/MatchPair.h>
#include <ktgp_orb/MatchStatistics.h>
#include <std_srvs/Trigger.h>
#include <unistd.h>

#include <opencv2/imgcodecs.hpp>
#include <random>

#include "robot_testing.h"

namespace ktgp_orb {
namespace {

using test::Camera;
using test::Recorder;

int cycles = 300;
constexpr int kSlowEvery = 10;  // cycles; in such a one a reference image of 48 megapixels is set

const std::string kMatcher = "/camera/matcher/";

/// Runs a function again and again in a thread of its own.
class Churn {
 public:
  explicit Churn(std::function<void(int)> act)
      : thread_([this, act = std::move(act)] {
          for (int i = 0; running_; ++i) act(i);
        }) {}
  ~Churn() {
    running_ = false;
    thread_.join();
  }

 private:
  std::atomic<bool> running_{true};
  std::thread thread_;
};

void setParameters(const std::function<void(dynamic_reconfigure::Config&)>& fill) {
  dynamic_reconfigure::Reconfigure call;
  fill(call.request.config);
  // False where the matcher has just gone; that is what is wanted.
  ros::service::call(kMatcher + "set_parameters", call);
}

void setThreshold(int i) {
  setParameters([i](dynamic_reconfigure::Config& config) {
    config.doubles.emplace_back();
    config.doubles.back().name = "T_w";
    config.doubles.back().value = i % 2 == 0 ? 0.6 : 0.7;
  });
  std::this_thread::sleep_for(std::chrono::milliseconds(i % 30));
}

void setReferenceImage(const std::string& path) {
  setParameters([&path](dynamic_reconfigure::Config& config) {
    config.strs.emplace_back();
    config.strs.back().name = "reference_image";
    config.strs.back().value = path;
  });
}

void callTriggers(int i) {
  static const char* const names[] = {"reset", "set_reference", "pause", "resume"};
  std_srvs::Trigger call;
  ros::service::call(kMatcher + names[i % 4], call);
}

void matchPair(const sensor_msgs::Image& image) {
  MatchPair call;
  call.request.reference = call.request.target = image;
  ros::service::call(kMatcher + "match_pair", call);
}

/// The values that a reference_image may have; anything else is garbage.
void expectNoGarbage(const std::string& large_image) {
  std::string value;
  if (!ros::param::get(kMatcher + "reference_image", value)) return;
  ASSERT_TRUE(value.empty() || value == large_image) << "reference_image is '" << value << "'";
  double t_w = 0.66;
  ros::param::get(kMatcher + "T_w", t_w);
  ASSERT_TRUE(t_w == 0.6 || t_w == 0.7 || t_w == 0.66) << "T_w is " << t_w;
}

std::string writeLargeImage() {
  const std::string path = "/tmp/ktgp_orb_large_" + std::to_string(getpid()) + ".png";
  cv::Mat pixels(6000, 8000, CV_8U);
  cv::randu(pixels, 0, 256);
  cv::imwrite(path, pixels, {cv::IMWRITE_PNG_COMPRESSION, 1});
  return path;
}

TEST(Teardown, UnloadingInTheMiddleOfEverything) {
  const std::string large_image = writeLargeImage();
  const test::View view({320, 240});
  Camera camera("/camera/image_raw", {320, 240}, 100.0);
  camera.start();
  nodelet::Loader loader(false);
  std::mt19937 random(3);
  {
    const Churn parameters(setThreshold);
    const Churn triggers(callTriggers);
    const Churn pairs([&view](int i) { matchPair(*view.image(i, ros::Time(1))); });
    const Churn subscribers([](int i) {
      Recorder<MatchStatistics> statistics(kMatcher + "statistics");
      Recorder<sensor_msgs::Image> overlay(kMatcher + "matches_image");
      std::this_thread::sleep_for(std::chrono::milliseconds(5 + i % 20));
    });
    for (int cycle = 0; cycle < cycles; ++cycle) {
      ASSERT_TRUE(test::loadMatcher(loader, "/camera")) << "cycle " << cycle;
      std::thread slow;
      if (cycle % kSlowEvery == 0) slow = std::thread(setReferenceImage, large_image);
      // No wait for anything: the unloading comes at any moment.
      std::this_thread::sleep_for(std::chrono::milliseconds(
          std::uniform_int_distribution<int>(0, slow.joinable() ? 300 : 60)(random)));
      ASSERT_TRUE(loader.unload("/camera/matcher")) << "cycle " << cycle;
      if (slow.joinable()) slow.join();
      ASSERT_NO_FATAL_FAILURE(expectNoGarbage(large_image)) << "cycle " << cycle;
      ros::param::set(kMatcher + "reference_image", "");
    }
  }
  // After all that it still does its work.
  Recorder<MatchStatistics> statistics(kMatcher + "statistics");
  ASSERT_TRUE(test::loadMatcher(loader, "/camera"));
  EXPECT_TRUE(test::waitUntil([&] {
    const auto& messages = statistics.messages();
    return !messages.empty() && messages.back()->status == MatchStatistics::STATUS_OK;
  }));
  loader.clear();
  unlink(large_image.c_str());
}

}  // namespace
}  // namespace ktgp_orb

int main(int argc, char** argv) {
  ktgp_orb::cycles = static_cast<int>(ktgp_orb::test::argument(argc, argv, "cycles", 300));
  return ktgp_orb::test::runTests(argc, argv, "robot_teardown_test");
}
