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
/// and explains why a reading is missing. Not thread-safe.
class GroundReadings {
 public:
  /// `tf` must outlive this object.
  explicit GroundReadings(const tf2::BufferCore& tf) : tf_(tf) {}

  /// `range_topic`, `imu_topic`: names of the topics; used only in the texts that explain problems.
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
  /// Returns true if all readings for the image have arrived: an Imu message with a later stamp is
  /// there, and tf knows the camera, the sensors and the ground at the time of the image. This
  /// assumes that the messages of the Imu arrive in the order of their stamps.
  bool complete(const std_msgs::Header& image) const;

  /// Options of the motion estimator for the camera's images. Throws std::invalid_argument if tf
  /// does not know the pose of the camera.
  GroundMotionOptions optionsFor(const std_msgs::Header& image) const;
  /// Combines a homography with all usable readings. `size`: size of its target image, px. Throws
  /// std::invalid_argument, with the reason, for a calibration that does not fit the image.
  GroundFrame frameOf(const HomographyStamped& homography, const cv::Size& size,
                      const sensor_msgs::CameraInfo& info, Pixels pixels);
  /// Reason why the newest frame has no rotation from the gyroscope; empty if it has one, or if the
  /// gyroscope is not used.
  const std::string& noTurn() const { return no_turn_; }
  /// Call this once for each frame, with its estimate. If the estimate has a pose, but no usable
  /// height or normal came for more than a second, changes the status to no_height or no_normal, so
  /// that the pose is not used. Otherwise returns the estimate unchanged.
  GroundEstimate withPatience(GroundEstimate estimate);
  /// Reason why no motion is known for the newest frame; empty if the motion is known.
  std::string problemOf(const GroundEstimate& estimate) const;
  /// Names a reading that is missing in the newest frame, or that is nearly ignored because it
  /// contradicts the other readings, and gives the likely cause. Empty if all readings are used.
  std::string notUsed(const GroundEstimate& estimate) const;
  /// Where the height and the normal come from, as words for messages to the user.
  std::string heightSource() const;
  std::string normalSource() const;

 private:
  // These functions return a reading for an image, or nothing if no reading is needed for this
  // image. They throw std::invalid_argument with the reason if a needed reading is missing.
  std::optional<HeightReading> height(const std_msgs::Header& image);
  /// The message whose stamp is nearest to the time of the image. Throws std::invalid_argument if
  /// no message is within max_age of the image.
  template <typename Message>
  const Message& nearest(const std::deque<Message>& messages, const std::string& what,
                         const ros::Time& image) const;
  std::optional<HeightReading> heightOfRange(const std_msgs::Header& image);
  void dropSidewaysBeam(GroundFrame& frame);
  // Reason why the newest frame has no usable height, normal or rotation; empty if it has a usable
  // one.
  std::string heightTrouble(const GroundEstimate& estimate) const;
  std::string normalTrouble(const GroundEstimate& estimate) const;
  std::string turnTrouble(const GroundEstimate& estimate) const;
  std::optional<DownReading> down(const std_msgs::Header& image);
  DownReading downOfImu(const std_msgs::Header& image) const;
  double usesOf(const sensor_msgs::Imu& imu, const std_msgs::Header& image) const;
  std::optional<TurnReading> turn(const std_msgs::Header& image);
  Pose3 transform(const std::string& target, const std::string& source,
                  const ros::Time& time) const;

  const tf2::BufferCore& tf_;
  GroundMotionConfig config_;
  std::string range_topic_;
  std::string imu_topic_;
  std::deque<sensor_msgs::Range> ranges_;
  std::deque<sensor_msgs::Imu> imus_;
  // Nanoseconds; readings whose stamps are out of order by up to this time are accepted.
  static constexpr std::int64_t kJitter = 1'000'000'000;
  util::StampOrder range_order_{kJitter};
  util::StampOrder imu_order_{kJitter};
  std::optional<sensor_msgs::Range> range_apart_;
  std::optional<sensor_msgs::Imu> imu_apart_;
  util::StampOrder image_order_;
  ros::Time used_range_;
  ros::Time range_stamp_;  // stamp of the newest frame's range message; 0: it has none
  std::string range_frame_;
  ros::Time last_image_;
  ros::Time last_height_;  // stamp of the last image for which a height was used
  ros::Time last_normal_;
  std::string no_height_;
  std::string no_normal_;
  std::string no_turn_;
};

/// Describes the rolling shutter (readout time and direction) that was estimated from the images;
/// empty if the estimate is not certain enough.
std::string shutterReport(const GroundEstimate& estimate);
/// A text that says that the images contradict the parameter readout_time; empty if they do not.
std::string shutterTrouble(const GroundEstimate& estimate, double readout_time);

}  // namespace ktgp_orb
