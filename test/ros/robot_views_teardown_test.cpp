// Unloading of the stabilizer and the mosaic during other work: images, homographies and
// calibrations, parameters, ~save, ~reset, and subscribers that are added and removed. There must
// be no crash, no hang, and no partial file.

#include <ktgp_orb/HomographyStamped.h>
#include <ktgp_orb/MatchStatus.h>
#include <ktgp_orb/SaveMosaic.h>
#include <sensor_msgs/CameraInfo.h>
#include <std_srvs/Trigger.h>

#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <random>

#include "robot_churn.h"

namespace ktgp_orb {
namespace {

using test::Change;
using test::Churn;
using test::Recorder;
using test::sleepMilliseconds;

const std::string kStabilizer = "/camera/stabilizer";
const std::string kMosaic = "/camera/mosaic";
const cv::Size kSize(320, 240);

/// A camera and its matcher: images, homographies and calibrations of consecutive views. Some
/// homographies are missing, some images are late, some are unusable.
class Views {
 public:
  Views()
      : images_(node_.advertise<sensor_msgs::Image>("/camera/image_raw", 5)),
        homographies_(node_.advertise<HomographyStamped>("/camera/matcher/homography", 10)),
        infos_(node_.advertise<sensor_msgs::CameraInfo>("/camera/camera_info", 5)) {}

  void send(int i) {
    const ros::Time stamp = ros::Time(1000) + ros::Duration(0.01 * i);
    const sensor_msgs::ImagePtr image = view_.image(i, stamp);
    if (i % 97 == 0) image->encoding = "nonsense";
    auto info = boost::make_shared<sensor_msgs::CameraInfo>();
    info->header = image->header;
    const bool late = i % 5 == 0;
    if (!late) images_.publish(image);
    homographies_.publish(homography(i, stamp));
    infos_.publish(info);
    if (late) images_.publish(image);
    sleepMilliseconds(8);
  }

 private:
  static HomographyStampedPtr homography(int i, const ros::Time& stamp) {
    // Like test::View: back and forth.
    const auto position = [](int number) { return std::abs(number % 80 - 40); };
    const double step = position(i - 1) - position(i);
    auto message = boost::make_shared<HomographyStamped>();
    message->header.stamp = stamp;
    message->reference_stamp = stamp - ros::Duration(0.01);
    message->status = i % 31 == 0 ? MatchStatus::STATUS_NO_MODEL : MatchStatus::STATUS_OK;
    message->homography = {1.0, 0.0, 5.0 * step, 0.0, 1.0, 3.0 * step, 0.0, 0.0, 1.0};
    return message;
  }

  const test::View view_{kSize};
  ros::NodeHandle node_;
  ros::Publisher images_;
  ros::Publisher homographies_;
  ros::Publisher infos_;
};

bool load(nodelet::Loader& loader, const std::string& name, const std::string& type) {
  return loader.load(name, type,
                     {{"/camera/image", "/camera/image_raw"},
                      {"/camera/homography", "/camera/matcher/homography"}},
                     {});
}

void changeParameters(int i) {
  Change()
      .set("lag", i % 4)
      .set("strength", i % 2 == 0 ? 0.2 : 0.5)
      .set("max_crop", i % 3 == 0 ? 0.05 : 0.1)
      .send(kStabilizer);
  Change()
      .set("lazy", i % 2 == 0)
      .set("picture_size", i % 5 == 0 ? 1600 : 400)
      .set("max_megapixels", i % 7 == 0 ? 1.0 : 64.0)
      .send(kMosaic);
  sleepMilliseconds(i % 30);
}

void subscribeForAMoment(int i) {
  Recorder<sensor_msgs::Image> steady(kStabilizer + "/image");
  Recorder<sensor_msgs::CameraInfo> info(kStabilizer + "/camera_info");
  Recorder<sensor_msgs::Image> mosaic(kMosaic + "/mosaic");
  Recorder<HomographyStamped> pose(kMosaic + "/homography");
  sleepMilliseconds(20 + i % 60);
}

std::string mapFile() {
  return "/tmp/ktgp_orb_map_" + std::to_string(getpid()) + ".png";
}

void save(int i) {
  SaveMosaic call;
  call.request.file = mapFile();
  ros::service::call(kMosaic + "/save", call);
  std_srvs::Trigger trigger;
  if (i % 5 == 0) ros::service::call(kMosaic + "/reset", trigger);
}

/// Checks that the last saved map is complete.
void expectWholeMap() {
  EXPECT_NE(access((mapFile() + ".part.png").c_str(), F_OK), 0) << "half a file is left";
  const cv::Mat map = cv::imread(mapFile(), cv::IMREAD_UNCHANGED);
  EXPECT_EQ(map.type(), CV_8UC4) << "no map was ever saved: the test shows nothing";
  unlink(mapFile().c_str());
}

TEST(ViewsTeardown, UnloadingInTheMiddleOfEverything) {
  nodelet::Loader loader(false);
  std::mt19937 random(5);
  Views views;
  const Churn camera([&views](int i) { views.send(i); });
  {
    const Churn parameters(changeParameters);
    const Churn saving(save);
    const Churn subscribers(subscribeForAMoment);
    const int cycles = test::argument("cycles", 40);
    for (int cycle = 0; cycle < cycles; ++cycle) {
      ASSERT_TRUE(load(loader, kStabilizer, "ktgp_orb/stabilizer")) << "cycle " << cycle;
      ASSERT_TRUE(load(loader, kMosaic, "ktgp_orb/mosaic")) << "cycle " << cycle;
      // No waiting: the unloading may come at any moment.
      sleepMilliseconds(std::uniform_int_distribution<int>(0, 120)(random));
      ASSERT_TRUE(loader.unload(kStabilizer)) << "cycle " << cycle;
      ASSERT_TRUE(loader.unload(kMosaic)) << "cycle " << cycle;
    }
  }
  // After all this they still work.
  for (const std::string& name : {kStabilizer, kMosaic}) ros::param::del(name);
  Recorder<sensor_msgs::Image> steady(kStabilizer + "/image");
  Recorder<HomographyStamped> pose(kMosaic + "/homography");
  ASSERT_TRUE(load(loader, kStabilizer, "ktgp_orb/stabilizer"));
  ASSERT_TRUE(load(loader, kMosaic, "ktgp_orb/mosaic"));
  EXPECT_TRUE(steady.waitForMore(3));
  EXPECT_TRUE(test::waitUntil([&] {
    const auto& messages = pose.messages();
    return !messages.empty() && messages.back()->status == MatchStatus::STATUS_OK;
  }));
  EXPECT_TRUE(test::waitUntil([] {
    SaveMosaic call;
    call.request.file = mapFile();
    return ros::service::call(kMosaic + "/save", call) && call.response.success;
  }));
  loader.clear();
  expectWholeMap();
}

}  // namespace
}  // namespace ktgp_orb
