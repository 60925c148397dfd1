#include "tools/bag_motion.h"

#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <tf2_msgs/TFMessage.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <regex>

#include "bag/reader.h"
#include "cli/output_file.h"

namespace ktgp_orb {
namespace {

constexpr const char* kPose[] = {"x", "y", "z", "roll", "pitch", "yaw"};
constexpr const char* kTwist[] = {"vx", "vy", "vz", "wx", "wy", "wz"};

/// Columns of a covariance: standard deviations, then what is above the diagonal.
void appendNames(const char* const* names, std::string& header) {
  for (int i = 0; i < 6; ++i) header += std::string(",dev_") + names[i];
  for (int i = 0; i < 6; ++i) {
    for (int j = i + 1; j < 6; ++j) header += std::string(",cov_") + names[i] + '_' + names[j];
  }
}

std::string header() {
  std::string text = "stamp,status,x,y,z,qx,qy,qz,qw,vx,vy,vz,wx,wy,wz";
  appendNames(kPose, text);
  appendNames(kTwist, text);
  return text + '\n';
}

void append(double value, std::string& row) {
  char text[32];
  std::snprintf(text, sizeof text, ",%.9g", value);
  row += text;
}

void append(const Covariance6& covariance, std::string& row) {
  for (int i = 0; i < 6; ++i) append(std::sqrt(covariance(i, i)), row);
  for (int i = 0; i < 6; ++i) {
    for (int j = i + 1; j < 6; ++j) append(covariance(i, j), row);
  }
}

/// Numbers that are not known are left empty.
std::string rowOf(const ros::Time& stamp, const GroundEstimate& estimate) {
  char text[64];
  std::snprintf(text, sizeof text, "%u.%09u,%s", stamp.sec, stamp.nsec, toString(estimate.status));
  std::string row = text;
  if (!estimate.hasPose()) return row + std::string(7 + 6 + 21 + 21, ',') + '\n';
  const Eigen::Vector3d position = estimate.base_to_odometry.translation();
  const Eigen::Quaterniond turn(Eigen::Matrix3d(estimate.base_to_odometry.linear()));
  for (int i = 0; i < 3; ++i) append(position(i), row);
  for (const double each : {turn.x(), turn.y(), turn.z(), turn.w()}) append(each, row);
  const bool moves = estimate.hasTwist();
  if (!moves) row += std::string(6, ',');
  for (int i = 0; moves && i < 6; ++i) append(estimate.twist(i), row);
  append(estimate.pose_covariance, row);
  if (moves) append(estimate.twist_covariance, row);
  if (!moves) row += std::string(21, ',');
  return row + '\n';
}

template <typename Message>
void passUntil(const ros::Time& time, std::deque<Message>& messages, GroundReadings& readings) {
  for (; !messages.empty() && messages.front().header.stamp <= time; messages.pop_front()) {
    readings.add(messages.front());
  }
}

/// So that the same problem with other numbers counts as the same one.
std::string withoutNumbers(const std::string& problem) {
  return std::regex_replace(problem, std::regex("-?[0-9]+\\.[0-9]+"), "...");
}

}  // namespace

void addMotionArguments(CLI::App& app, MotionFile& motion) {
  const char* const group = "Motion in metres (see doc/motion.md)";
  GroundMotionConfig& config = motion.config;
  CLI::Option* const table =
      app.add_option(
             "--motion", motion.path,
             "write a table with velocity and odometry of a camera that looks at the ground")
          ->type_name("FILE")
          ->group(group);
  const auto add = [&](const char* name, auto& value, const char* text) {
    return app.add_option(name, value, text)->capture_default_str()->needs(table)->group(group);
  };
  add("--motion_range", motion.range_topic,
      "topic of the range; without it: range beside the images");
  add("--motion_imu", motion.imu_topic, "topic of the Imu; without it: imu beside the images");
  add("--motion_height_source", config.height_source, "range, tf_height or parameter")
      ->check(CLI::IsMember({"range", "tf_height", "parameter"}));
  add("--motion_height", config.height, "height of the camera, for the source parameter [m]")
      ->check(tools::numberIn(limitsOf("ground_motion", "height")));
  add("--motion_height_deviation", config.height_deviation,
      "standard deviation of a height, as a share of it")
      ->check(tools::numberIn(limitsOf("ground_motion", "height_deviation")));
  add("--motion_max_age", config.max_age,
      "a range or an Imu farther from the image than this is not used [s]")
      ->check(tools::numberIn(limitsOf("ground_motion", "max_age")));
  add("--motion_readout_time", config.readout_time,
      "from the first row of an image to the last one; 0: global shutter, -1: not known [s]")
      ->check(tools::numberIn(limitsOf("ground_motion", "readout_time")));
  add("--motion_gyro", config.gyro, "take the rotation from the Imu's angular velocity, too");
  add("--motion_normal_source", config.normal_source, "down, imu, tf_normal or motion")
      ->check(CLI::IsMember({"down", "imu", "tf_normal", "motion"}));
  add("--motion_base_frame", config.base_frame, "frame of velocity and pose; empty: the camera's");
}

BagMotion::BagMotion(const MotionFile& options, const std::string& bag,
                     const std::string& image_topic)
    : options_(options) {
  if (options_.path.empty()) return;
  const std::string beside = cameraOf(image_topic);
  if (options_.range_topic.empty()) options_.range_topic = beside + "/range";
  if (options_.imu_topic.empty()) options_.imu_topic = beside + "/imu";
  pixels_ = pixelsFrom(options_.config.calibration, image_topic);
  info_ = readCameraInfo(bag, image_topic);
  readings_.configure(options_.config, options_.range_topic, options_.imu_topic);
  readMessages(bag);
}

void BagMotion::readMessages(const std::string& path) {
  try {
    rosbag::Bag bag(path);
    rosbag::View view(bag, rosbag::TopicQuery(std::vector<std::string>{
                               options_.range_topic, options_.imu_topic, "/tf", "/tf_static"}));
    for (const rosbag::MessageInstance& instance : view) {
      if (const auto range = instance.instantiate<sensor_msgs::Range>()) {
        ranges_.push_back(*range);
      } else if (const auto imu = instance.instantiate<sensor_msgs::Imu>()) {
        imus_.push_back(*imu);
      } else if (const auto tf = instance.instantiate<tf2_msgs::TFMessage>()) {
        const bool is_static = instance.getTopic() == "/tf_static";
        for (const auto& each : tf->transforms) {
          if (is_static) tf_.setTransform(each, "bag", true);
          if (!is_static) transforms_.push_back(each);
        }
      }
    }
  } catch (const rosbag::BagException& error) {
    throw std::runtime_error(path + ": --motion cannot read it: " + error.what());
  }
}

void BagMotion::passOn(const ros::Time& time) {
  const ros::Time until = time + ros::Duration(options_.config.max_age);
  passUntil(until, ranges_, readings_);
  passUntil(until, imus_, readings_);
  for (; !transforms_.empty() && transforms_.front().header.stamp <= until;
       transforms_.pop_front()) {
    tf_.setTransform(transforms_.front(), "bag");
  }
}

void BagMotion::add(const HomographyStamped& homography, const cv::Size& image) {
  if (options_.path.empty()) return;
  ++frames_;
  passOn(homography.header.stamp);
  GroundEstimate estimate;
  std::string problem;
  try {
    motion_.setOptions(readings_.optionsFor(homography.header));
    estimate = motion_.add(readings_.frameOf(homography, image, info_, pixels_));
    problem = estimate.hasPose() ? readings_.notUsed(estimate) : readings_.problemOf(estimate);
    shutter_ = shutterReport(estimate);
  } catch (const std::invalid_argument& error) {
    problem = error.what();
  }
  if (!problem.empty()) ++problems_[withoutNumbers(problem)];
  if (estimate.hasPose()) ++known_;
  rows_ += rowOf(homography.header.stamp, estimate);
}

void BagMotion::close() {
  if (!options_.path.empty()) tools::writeText(options_.path, header() + rows_, options_.force);
}

std::string BagMotion::report() const {
  if (options_.path.empty()) return "";
  std::string text = options_.path + ": motion of " + std::to_string(known_) + " of " +
                     std::to_string(frames_) + " frames, height from " + readings_.heightSource() +
                     ", normal from " + readings_.normalSource();
  if (!shutter_.empty()) text += "; " + shutter_;
  const auto most =
      std::max_element(problems_.begin(), problems_.end(),
                       [](const auto& a, const auto& b) { return a.second < b.second; });
  if (most != problems_.end()) {
    text += "; most often (" + std::to_string(most->second) + " frames): " + most->first;
  }
  return text + '\n';
}

}  // namespace ktgp_orb
