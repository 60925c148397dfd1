// Unloading during other work: parameters (fast ones, and slow ones that read files), services,
// pairs to match, images, masks, references, calibrations, and subscribers that are added and
// removed. There must be no crash, no hang, and no parameter left that was not set.

#include <ktgp_orb/HomographyStamped.h>
#include <ktgp_orb/MatchPair.h>
#include <ktgp_orb/MatchStatistics.h>
#include <ktgp_orb/MatchStatus.h>
#include <std_srvs/Trigger.h>

#include <algorithm>
#include <array>
#include <map>
#include <random>
#include <set>

#include "robot_churn.h"

namespace ktgp_orb {
namespace {

using test::Camera;
using test::Change;
using test::Churn;
using test::PictureFile;
using test::Recorder;
using test::sleepMilliseconds;

constexpr int kSlowEvery = 10;  // cycles; in these a reference image of 48 megapixels is set

const std::string kMatcher = "/camera/matcher";
const cv::Size kSize(320, 240);

cv::Mat noise(const cv::Size& size) {
  cv::Mat pixels(size, CV_8U);
  cv::randu(pixels, 0, 256);
  return pixels;
}

/// The files for parameters.
struct Files {
  PictureFile large{"large", noise({8000, 6000})};
  PictureFile reference{"reference", test::textureImage(kSize, 1)};
  PictureFile mask{"mask", cv::Mat(kSize, CV_8U, cv::Scalar(255))};
};

/// Changes one group of parameters at a time, like a user with sliders and file names.
void changeParameters(const Files& files, int i) {
  const bool odd = i % 2 == 1;
  Change change;
  switch (i / 2 % 5) {
    case 0:
      change.set("T_w", odd ? 0.6 : 0.7);
      break;
    case 1:
      change.set("rectify", odd).set("max_rate", odd ? 50.0 : 0.0);
      break;
    case 2:
      change.set("mask_image", odd ? files.mask.path() : "");
      break;
    case 3:
      change.set("roi", std::string(odd ? "20 20 250 200" : ""));
      break;
    default:
      change.set("reference_mode", std::string(odd ? "fixed" : "previous"))
          .set("reference_image", odd ? files.reference.path() : "");
  }
  change.send(kMatcher);
  sleepMilliseconds(i % 30);
}

/// Sends the other inputs: every third one is unusable.
class SideInputs {
 public:
  SideInputs()
      : mask_(node_.advertise<sensor_msgs::Image>(kMatcher + "/mask", 1, true)),
        reference_(node_.advertise<sensor_msgs::Image>(kMatcher + "/reference", 1)),
        info_(node_.advertise<sensor_msgs::CameraInfo>("/camera/camera_info", 5)) {}

  void send(int i) {
    switch (i % 3) {
      case 0:
        mask_.publish(boost::make_shared<sensor_msgs::Image>());  // none
        reference_.publish(boost::make_shared<sensor_msgs::Image>());
        break;
      case 1:
        mask_.publish(white_);
        reference_.publish(view_.image(i, ros::Time(1)));
        break;
      default:
        mask_.publish(unusable());
        reference_.publish(unusable());
    }
    info_.publish(calibration(i));
    sleepMilliseconds(i % 20);
  }

 private:
  static sensor_msgs::ImagePtr unusable() {
    auto image = boost::make_shared<sensor_msgs::Image>();
    image->width = image->height = 9;
    image->encoding = "nonsense";
    return image;
  }
  static sensor_msgs::ImagePtr white() {
    auto image = test::View(kSize).image(0, ros::Time(1));
    std::fill(image->data.begin(), image->data.end(), 255);
    return image;
  }
  sensor_msgs::CameraInfoPtr calibration(int i) const {
    auto info = boost::make_shared<sensor_msgs::CameraInfo>(
        test::calibration(kSize, 250.0, -0.1 - 0.01 * (i % 5)));  // the lens changes, too
    if (i % 7 == 0) info->distortion_model = "unheard_of";
    info->R = {1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0};
    info->P = {250.0, 0.0, 160.0, 0.0, 0.0, 250.0, 120.0, 0.0, 0.0, 0.0, 1.0, 0.0};
    return info;
  }

  const test::View view_{kSize};
  const sensor_msgs::ImageConstPtr white_ = white();
  ros::NodeHandle node_;
  ros::Publisher mask_;
  ros::Publisher reference_;
  ros::Publisher info_;
};

void callTriggers(int i) {
  static const std::array<const char*, 4> names{"/reset", "/set_reference", "/pause", "/resume"};
  std_srvs::Trigger call;
  ros::service::call(kMatcher + names[static_cast<std::size_t>(i) % names.size()], call);
}

void matchPair(const sensor_msgs::Image& image) {
  MatchPair call;
  call.request.reference = call.request.target = image;
  ros::service::call(kMatcher + "/match_pair", call);
}

void subscribeForAMoment(int i) {
  Recorder<MatchStatistics> statistics(kMatcher + "/statistics");
  Recorder<HomographyStamped> homographies(kMatcher + "/homography");
  Recorder<sensor_msgs::Image> overlay(kMatcher + "/matches_image");
  sleepMilliseconds(5 + i % 20);
}

/// Checks that the parameter server has only parameters that were set.
void expectNoGarbage(const Files& files) {
  const std::map<std::string, std::set<std::string>> texts = {
      {"reference_image", {"", files.large.path(), files.reference.path()}},
      {"mask_image", {"", files.mask.path()}},
      {"roi", {"", "20 20 250 200"}},
      {"reference_mode", {"previous", "fixed"}}};
  XmlRpc::XmlRpcValue all;  // one call of the master
  if (!ros::param::get(kMatcher, all)) return;
  for (const auto& [name, values] : texts) {
    if (!all.hasMember(name)) continue;
    const std::string value = static_cast<std::string>(all[name]);
    ASSERT_EQ(values.count(value), 1U) << name << " is '" << value << "'";
  }
  if (!all.hasMember("T_w")) return;
  const auto t_w = static_cast<double>(all["T_w"]);
  ASSERT_TRUE(t_w == 0.6 || t_w == 0.7 || t_w == 0.0) << "T_w is " << t_w;
}

TEST(Teardown, UnloadingInTheMiddleOfEverything) {
  const Files files;
  const test::View view(kSize);
  Camera camera("/camera/image_raw", kSize, 100.0);
  camera.start();
  nodelet::Loader loader(false);
  std::mt19937 random(3);
  {
    SideInputs inputs;
    const Churn parameters([&files](int i) { changeParameters(files, i); });
    const Churn triggers(callTriggers);
    const Churn pairs([&view](int i) { matchPair(*view.image(i, ros::Time(1))); });
    const Churn sides([&inputs](int i) { inputs.send(i); });
    const Churn subscribers(subscribeForAMoment);
    const int cycles = test::argument("cycles", 50);
    for (int cycle = 0; cycle < cycles; ++cycle) {
      ASSERT_TRUE(test::loadMatcher(loader, "/camera")) << "cycle " << cycle;
      std::thread slow;
      if (cycle % kSlowEvery == 0) {
        slow = std::thread(
            [&files] { Change().set("reference_image", files.large.path()).send(kMatcher); });
      }
      // No waiting: the unloading may come at any moment.
      sleepMilliseconds(std::uniform_int_distribution<int>(0, slow.joinable() ? 300 : 60)(random));
      ASSERT_TRUE(loader.unload(kMatcher)) << "cycle " << cycle;
      if (slow.joinable()) slow.join();
      ASSERT_NO_FATAL_FAILURE(expectNoGarbage(files)) << "cycle " << cycle;
      ros::param::set(kMatcher + "/reference_image", "");
    }
  }
  // After all this it still works.
  ros::param::del(kMatcher);
  Recorder<MatchStatistics> statistics(kMatcher + "/statistics");
  ASSERT_TRUE(test::loadMatcher(loader, "/camera"));
  EXPECT_TRUE(test::waitUntil([&] {
    const auto& messages = statistics.messages();
    return !messages.empty() && messages.back()->status == MatchStatus::STATUS_OK;
  }));
  loader.clear();
}

}  // namespace
}  // namespace ktgp_orb
