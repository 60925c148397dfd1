// Writes the demo bag: a camera that flies over a drawn map, with the true homographies.

#include <ktgp_orb/HomographyStamped.h>
#include <ktgp_orb/MatchStatus.h>
#include <rosbag/bag.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <std_msgs/String.h>

#include <Eigen/LU>
#include <cmath>
#include <filesystem>
#include <memory>
#include <opencv2/core/utility.hpp>
#include <string>
#include <vector>

#include "demo/effects.h"
#include "demo/flight.h"
#include "demo/map.h"
#include "demo/motion_messages.h"
#include "demo/signs.h"
#include "files/input.h"
#include "files/output_file.h"
#include "ros/message_conversion.h"
#include "tools/matcher_cli.h"
#include "tools/program.h"

namespace ktgp_orb::demo {
namespace {

constexpr std::uint32_t kStart = 1600000000;  // s; fixed, so that the bag is always the same

std_msgs::Header headerOf(int frame) {
  std_msgs::Header header;
  header.stamp = ros::Time(kStart) + ros::Duration(frame / kFrameRate);
  header.frame_id = "camera";
  header.seq = static_cast<std::uint32_t>(frame);
  return header;
}

sensor_msgs::CameraInfo cameraInfo(int frame) {
  sensor_msgs::CameraInfo info;
  info.header = headerOf(frame);
  info.width = kImageWidth;
  info.height = kImageHeight;
  info.distortion_model = "plumb_bob";
  info.D.assign(5, 0.0);
  const double cx = 0.5 * (kImageWidth - 1);
  const double cy = 0.5 * (kImageHeight - 1);
  info.K = {kFocalLength, 0, cx, 0, kFocalLength, cy, 0, 0, 1};
  info.R = {1, 0, 0, 0, 1, 0, 0, 0, 1};
  info.P = {kFocalLength, 0, cx, 0, 0, kFocalLength, cy, 0, 0, 0, 1, 0};
  return info;
}

/// The true homography from the previous frame to `frame`.
HomographyStamped truth(int frame, const Manner& manner) {
  const Eigen::Matrix3d previous = imageFromMap((frame - 1) / kFrameRate, manner);
  const Eigen::Matrix3d current = imageFromMap(frame / kFrameRate, manner);
  const Eigen::Matrix3d h = current * previous.inverse();
  HomographyStamped message;
  message.header = headerOf(frame);
  message.reference_stamp = headerOf(frame - 1).stamp;
  message.status = MatchStatus::STATUS_OK;
  Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(message.homography.data()) = h / h(2, 2);
  return message;
}

struct Scene {
  cv::Mat map;
  std::vector<Sign> signs;  ///< on the map
  int frames = 0;
  std::uint64_t seed = 1;
  Manner manner;
};

void writeFrame(const cv::Mat& picture, int frame, const Scene& scene, rosbag::Bag& bag) {
  const Manner& manner = scene.manner;
  const ros::Time stamp = headerOf(frame).stamp;
  bag.write("/camera/camera_info", stamp, cameraInfo(frame));
  if (frame > 0) bag.write("/camera/ground_truth/homography", stamp, truth(frame, manner));
  std_msgs::String segment;
  segment.data = toString(segmentOf(frame, scene.frames));
  bag.write("/camera/segment", stamp, segment);
  writeMotion(headerOf(frame), frame / kFrameRate, scene.seed, manner, bag);
  if (!scene.signs.empty()) {
    bag.write("/camera/ground_truth/targets", stamp,
              truthOf(scene.signs, headerOf(frame), imageFromMap(frame / kFrameRate, manner)));
  }
  bag.write("/camera/image_raw", stamp, toImage(headerOf(frame), "bgr8", picture));
}

void writeFrames(const Scene& scene, rosbag::Bag& bag) {
  tools::ProgressBar progress(static_cast<std::size_t>(scene.frames));
  constexpr int kBatch = 16;  // frames drawn in parallel
  std::vector<cv::Mat> pictures(kBatch);
  for (int first = 0; first < scene.frames && !tools::interrupted(); first += kBatch) {
    const int count = std::min(kBatch, scene.frames - first);
    cv::parallel_for_(cv::Range(0, count), [&](const cv::Range& range) {
      for (int i = range.start; i < range.end; ++i) {
        pictures[static_cast<std::size_t>(i)] =
            takePicture(scene.map, first + i, scene.frames, scene.seed, scene.manner);
      }
    });
    for (int i = 0; i < count; ++i) {
      writeFrame(pictures[static_cast<std::size_t>(i)], first + i, scene, bag);
      progress.advance("frames");
    }
  }
}

void writeBag(const std::string& path, const Scene& scene, bool force) {
  files::OutputFile file(path, force);
  // The destructor of a bag closes it and throws if the disk is full, which would end the program.
  // So after an error the bag is not destroyed.
  auto bag = std::make_unique<rosbag::Bag>(file.unfinished(), rosbag::bagmode::Write);
  try {
    writeFrames(scene, *bag);
    bag->close();
  } catch (const rosbag::BagException& error) {
    static_cast<void>(bag.release());
    throw files::FileError(path, std::string("cannot be written: ") + error.what());
  }
  if (!tools::interrupted()) file.commit();
}

int run(int argc, char** argv) {
  std::string path;
  double seconds = 10.0;
  Scene scene;
  CLI::App app(
      "Writes a bag with a camera that flies over a drawn map: /camera/image_raw (640x480, 30 Hz), "
      "/camera/camera_info, the true homography from each frame to the next on "
      "/camera/ground_truth/homography, and on /camera/segment the difficulty of the frame: clean, "
      "lighting, blur or noise.\nFor the motion in metres: the true pose and velocity on "
      "/camera/ground_truth/odometry, the distance of the ground with 1 % noise on /camera/range, "
      "and orientation and angular velocity with 0.5 degrees and 0.2 degrees/s noise on "
      "/camera/imu.\nThe same seed and length give the same bag.");
  app.add_option("bag", path, "file to write")->required();
  app.add_option("--seconds", seconds, "length of the flight")
      ->check(tools::numberIn({0.2, 600.0}))
      ->capture_default_str();
  app.add_option("--seed", scene.seed, "seed of the map and the noise")->capture_default_str();
  app.add_option("--shake", scene.manner.shake, "shake of the camera, root mean square [px]")
      ->check(tools::numberIn({0.0, 50.0}))
      ->capture_default_str();
  app.add_option("--tilt", scene.manner.tilt,
                 "largest pitch of the camera; the largest roll is 0.8 of it [degrees]")
      ->check(tools::numberIn({0.0, 25.0}))
      ->capture_default_str();
  std::string targets;
  app.add_option("--targets", targets,
                 "draw three signs on the ground, one of them twice, and write their pictures and "
                 "their list, targets.yaml, into this folder; /camera/ground_truth/targets has "
                 "where they are, and their poses")
      ->type_name("FOLDER");
  bool force = false;
  tools::addCommonOptions(app, force);
  app.footer(tools::kExitCodes);
  if (const auto code = tools::parse(app, argc, argv)) return *code;
  files::OutputPlan plan = tools::planOutputs(app, force);
  plan.write(path);
  if (!targets.empty()) {
    scene.signs = drawSigns();
    std::error_code failed;  // the output plan reports what cannot be written
    std::filesystem::create_directories(targets, failed);
    for (const std::string& file : filesOf(scene.signs, targets)) plan.write(file);
  }
  tools::stopWhenInterrupted();
  scene.frames = static_cast<int>(std::lround(seconds * kFrameRate));
  scene.map = drawMap(scene.seed);
  paintOnto(scene.signs, scene.map);
  if (!targets.empty()) writeSigns(scene.signs, targets, force);
  writeBag(path, scene, force);
  return tools::interrupted() ? tools::kExitInterrupted : tools::kExitDone;
}

}  // namespace
}  // namespace ktgp_orb::demo

int main(int argc, char** argv) {
  return ktgp_orb::tools::runProgram("make_demo_bag",
                                     [&] { return ktgp_orb::demo::run(argc, argv); });
}
