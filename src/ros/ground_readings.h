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

namespace ktgp_orb {

/// Collects what the ground motion needs beside the homography, from messages and tf, and knows
/// why something is missing. An instance belongs to one thread at a time.
class GroundReadings {
 public:
  /// `tf` must live longer.
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
  /// Whether no later message can tell more about the image, unless stamps jitter: an Imu after it
  /// has come, and tf knows where the camera, the sensors and the ground are at its time.
  bool complete(const std_msgs::Header& image) const;

  /// Options for the images of that camera. Throws std::invalid_argument where tf does not know
  /// where the camera is.
  GroundMotionOptions optionsFor(const std_msgs::Header& image) const;
  /// The frame of a homography to an image of `size`, with all usable readings. Throws
  /// std::invalid_argument, with the reason, for a calibration that does not fit the image.
  GroundFrame frameOf(const HomographyStamped& homography, const cv::Size& size,
                      const sensor_msgs::CameraInfo& info, Pixels pixels);
  /// Why the newest frame has no rotation; empty: it has, or needs none.
  const std::string& noTurn() const { return no_turn_; }
  /// The estimate for the newest frame; call it once for each frame. After a second without a
  /// usable height or normal, the estimate has the status that says so in place of a pose.
  GroundEstimate withPatience(GroundEstimate estimate);
  /// Why the newest frame has no motion; empty: it has.
  std::string problemOf(const GroundEstimate& estimate) const;
  /// Which reading of the newest frame is missing, or contradicts the others so that it hardly
  /// counts, with the likely cause; empty: none.
  std::string notUsed(const GroundEstimate& estimate) const;
  /// Where the height and the normal come from, in words for messages.
  std::string heightSource() const;
  std::string normalSource() const;

 private:
  // The readings for an image; empty: none is wanted now. Throw std::invalid_argument with the
  // reason why one is missing.
  std::optional<HeightReading> height(const std_msgs::Header& image);
  /// The reading nearest to the time of an image. Throws std::invalid_argument where there is none
  /// within max_age.
  template <typename Message>
  const Message& nearest(const std::deque<Message>& messages, const std::string& what,
                         const ros::Time& image) const;
  std::optional<HeightReading> heightOfRange(const std_msgs::Header& image);
  void dropSidewaysBeam(GroundFrame& frame);
  // Why the newest frame has no usable height.
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
  bool range_went_back_ = false;
  bool imu_went_back_ = false;
  bool image_went_back_ = false;
  ros::Time used_range_;
  ros::Time range_stamp_;  // stamp of the newest frame's reading; 0: it has none
  std::string range_frame_;
  ros::Time last_image_;
  ros::Time last_height_;  // stamp of the last reading that was used
  ros::Time last_normal_;
  std::string no_height_;
  std::string no_normal_;
  std::string no_turn_;
};

/// The rolling shutter that the pictures show, as text; empty: nothing certain.
std::string shutterReport(const GroundEstimate& estimate);
/// How the pictures contradict the parameter readout_time, as text; empty: they do not.
std::string shutterTrouble(const GroundEstimate& estimate, double readout_time);

}  // namespace ktgp_orb
