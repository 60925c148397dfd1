#pragma once

#include <tf2/buffer_core.h>

#include <deque>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "bag/reader.h"
#include "files/output_file.h"
#include "ros/ground_readings.h"
#include "ros/message_conversion.h"
#include "tools/matcher_cli.h"

namespace ktgp_orb::tools {

/// Options of the table with the motion in metres. If `path` is empty, no table is written.
struct MotionFile {
  std::string path;
  std::string range_topic;  ///< empty: "range" beside the images
  std::string imu_topic;    ///< empty: "imu" beside the images
  GroundMotionConfig config = groundMotionDefaults();
};

void addMotionArguments(CLI::App& app, MotionFile& motion);

/// Computes the motion of the frames of a bag as the nodelet does, from the calibration, ranges,
/// Imus and transforms in the bag.
class BagMotion {
 public:
  /// If `options.path` is empty, this class does nothing. `camera`, if given, is used instead of
  /// the bag's camera_info. Throws UnusableBag for a bag without a calibration.
  BagMotion(const MotionFile& options, const std::string& bag, const std::string& image_topic,
            const std::optional<sensor_msgs::CameraInfo>& camera);

  void add(const HomographyStamped& homography, const cv::Size& image);
  /// Writes the table. Throws FileError.
  void close(files::Outputs& outputs);
  /// Whether a table was wanted but no frame has a motion.
  bool foundNone() const { return !options_.path.empty() && known_ == 0; }
  /// Summary for users in a few lines; empty if no table was wanted.
  std::string report() const;

 private:
  /// Messages of one kind, sorted by their stamps, so that a message with a stamp in the future
  /// does not delay others. If the clock was set back, a new part begins.
  template <typename Message>
  class Readings {
   public:
    Readings() = default;
    Readings(const std::vector<Message>& arrived);  // NOLINT: the same in another order
    /// Calls `use` with each message whose stamp is at most `time`, and removes these messages.
    /// `restarted`: the stamps of the images have gone back, so the next part begins.
    template <typename Use>
    void passUntil(const ros::Time& time, bool restarted, const Use& use);
    bool goesOn() const { return parts_.size() > 1; }

   private:
    std::deque<std::multimap<ros::Time, Message>> parts_;
  };

  void checkTypes(const std::string& bag, const BagMessages& messages) const;
  void readMessages(const std::string& bag);
  /// Passes the messages with stamps up to max_age after `time` to readings_ and tf_.
  void passOn(const ros::Time& time);
  void count(bool is_known, const std::string& reason);

  MotionFile options_;
  tf2::BufferCore tf_{ros::Duration(60.0)};
  GroundReadings readings_{tf_};
  GroundMotion motion_;
  sensor_msgs::CameraInfo info_;
  Pixels pixels_ = Pixels::raw;
  Readings<sensor_msgs::Range> ranges_;
  Readings<sensor_msgs::Imu> imus_;
  Readings<geometry_msgs::TransformStamped> transforms_;
  ros::Time last_;  // stamp of the newest image
  std::string rows_;
  /// For each problem, the number of frames with it, and its first full text. The key is the text
  /// without numbers.
  std::map<std::string, std::pair<std::size_t, std::string>> problems_;
  std::string shutter_;             // shutter report of the newest frame with motion
  std::optional<ImuMounting> imu_;  // last known mounting of the Imu
  std::size_t frames_ = 0;
  std::size_t known_ = 0;
};

}  // namespace ktgp_orb::tools
