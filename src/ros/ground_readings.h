#pragma once

#include <ktgp_orb/HomographyStamped.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Imu.h>
#include <sensor_msgs/Range.h>
#include <tf2/buffer_core.h>

#include <deque>
#include <optional>
#include <string>

#include "ktgp_orb/ground_motion.h"
#include "ros/camera.h"
#include "ros/configuration.h"
#include "util/stamp_order.h"

namespace ktgp_orb {

/// Collects the readings that the ground motion needs besides the homography, from messages and tf,
/// and explains why a reading is missing. An instance belongs to one thread at a time.
class GroundReadings {
 public:
  /// `tf` must outlive this object.
  explicit GroundReadings(const tf2::BufferCore& tf) : tf_(tf) {}

  /// `range_topic`, `imu_topic`: names of the topics for explanations.
  void configure(const GroundMotionConfig& config, const std::string& range_topic,
                 const std::string& imu_topic) {
    config_ = config;
    range_topic_ = range_topic;
    imu_topic_ = imu_topic;
  }
  void add(const sensor_msgs::Range& range);
  void add(const sensor_msgs::Imu& imu);

  bool usesRange() const { return config_.height_source == "range"; }
  bool usesNormal() const { return config_.normal_source != "motion"; }
  bool usesImu() const { return config_.normal_source == "imu" || config_.gyro; }
  /// Whether all readings for the image have arrived, provided that stamps do not jitter: an Imu
  /// message with a later stamp has arrived, and tf knows the camera, the sensors and the ground at
  /// the time of the image.
  bool complete(const std_msgs::Header& image) const;

  /// Options for the camera's images. Throws std::invalid_argument if tf does not know the pose of
  /// the camera.
  GroundMotionOptions optionsFor(const std_msgs::Header& image) const;
  /// Combines a homography with all usable readings. `size`: size of its target image, px. Throws
  /// std::invalid_argument, with the reason, for a calibration that does not fit the image.
  GroundFrame frameOf(const HomographyStamped& homography, const cv::Size& size,
                      const sensor_msgs::CameraInfo& info, Pixels pixels);
  /// Why the newest frame has no rotation; empty if it has a rotation or needs none.
  const std::string& noTurn() const { return no_turn_; }
  /// Completes the estimate for the newest frame; call this once for each frame. After a second
  /// without a usable height or normal, the status says so, and the estimate has no pose.
  GroundEstimate withPatience(GroundEstimate estimate);
  /// Why the newest frame has no motion; empty if it has a motion.
  std::string problemOf(const GroundEstimate& estimate) const;
  /// Names the reading of the newest frame that is missing, or that hardly counts because it
  /// contradicts the other readings, with the likely cause. Empty if all readings are used.
  std::string notUsed(const GroundEstimate& estimate) const;
  /// The sources of the height and of the normal, in words for messages.
  std::string heightSource() const;
  std::string normalSource() const;

 private:
  // These functions return a reading for an image, or nothing if no reading is wanted now. They
  // throw std::invalid_argument with the reason if a reading is missing.
  std::optional<HeightReading> height(const std_msgs::Header& image);
  /// The reading nearest to the time of an image. Throws std::invalid_argument if there is no
  /// reading within max_age of the image.
  template <typename Message>
  const Message& nearest(const std::deque<Message>& messages, const std::string& what,
                         const ros::Time& image) const;
  std::optional<HeightReading> heightOfRange(const std_msgs::Header& image);
  void dropSidewaysBeam(GroundFrame& frame);
  // Why the newest frame has no usable height, normal or rotation.
  std::string heightTrouble(const GroundEstimate& estimate) const;
  std::string normalTrouble(const GroundEstimate& estimate) const;
  std::string turnTrouble(const GroundEstimate& estimate) const;
  std::optional<DownReading> down(const std_msgs::Header& image);
  DownReading downOfImu(const std_msgs::Header& image) const;
  std::optional<TurnReading> turn(const std_msgs::Header& image);
  Pose3 transform(const std::string& target, const std::string& source,
                  const ros::Time& time) const;

  const tf2::BufferCore& tf_;
  GroundMotionConfig config_;
  std::string range_topic_;
  std::string imu_topic_;
  std::deque<sensor_msgs::Range> ranges_;
  std::deque<sensor_msgs::Imu> imus_;
  static constexpr std::int64_t kJitter = 1'000'000'000;  // ns, of the stamps of readings
  util::StampOrder range_order_{kJitter};
  util::StampOrder imu_order_{kJitter};
  std::optional<sensor_msgs::Range> range_apart_;
  std::optional<sensor_msgs::Imu> imu_apart_;
  util::StampOrder image_order_;
  ros::Time used_range_;
  ros::Time range_stamp_;  // stamp of the range of the newest frame; 0: the frame has no range
  std::string range_frame_;
  ros::Time last_image_;
  ros::Time last_height_;  // stamp of the last image with a used height
  ros::Time last_normal_;
  std::string no_height_;
  std::string no_normal_;
  std::string no_turn_;
};

/// Describes the rolling shutter that the images show; empty if they do not show one with
/// certainty.
std::string shutterReport(const GroundEstimate& estimate);
/// Reports that the pictures contradict the parameter readout_time; empty if they do not.
std::string shutterTrouble(const GroundEstimate& estimate, double readout_time);

}  // namespace ktgp_orb
