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

/// Options of the table with the camera's motion in metres. If `path` is empty, no table is
/// written.
struct MotionFile {
  std::string path;
  std::string range_topic;  ///< empty: "range" beside the images
  std::string imu_topic;    ///< empty: "imu" beside the images
  GroundMotionConfig config = groundMotionDefaults();
};

void addMotionArguments(CLI::App& app, MotionFile& motion);

/// Computes the camera's motion for the frames of a bag as the ground motion nodelet does, from the
/// calibration, ranges, Imu messages and transforms in the bag.
class BagMotion {
 public:
  /// If `options.path` is empty, this class does nothing. Uses `camera`, if given, instead of the
  /// bag's camera_info. Throws UnusableBag if there is neither `camera` nor a camera_info.
  BagMotion(const MotionFile& options, const std::string& bag, const std::string& image_topic,
            const std::optional<sensor_msgs::CameraInfo>& camera);

  void add(const HomographyStamped& homography, const cv::Size& image);
  /// Writes the table. Throws FileError.
  void close(files::Outputs& outputs);
  /// Returns true if a table was wanted, but no motion was found in any frame.
  bool foundNone() const { return !options_.path.empty() && known_ == 0; }
  /// Summary for users in a few lines; empty if no table was wanted.
  std::string report() const;

 private:
  /// Messages of one kind, sorted by their stamps, so that a message with a stamp in the future
  /// does not hold up the messages after it. When the clock is set back, a new part begins, which
  /// is sorted separately.
  template <typename Message>
  class Readings {
   public:
    Readings() = default;
    Readings(const std::vector<Message>& arrived);  // NOLINT: the same in another order
    /// Calls `use` with each message of the current part whose stamp is at most `time`, and removes
    /// these messages. `restarted`: the stamps of the images have just gone back, so continue with
    /// the next part.
    template <typename Use>
    void passUntil(const ros::Time& time, bool restarted, const Use& use);
    bool goesOn() const { return parts_.size() > 1; }

   private:
    std::deque<std::multimap<ros::Time, Message>> parts_;
  };

  void checkTypes(const std::string& bag, const BagMessages& messages) const;
  void readMessages(const std::string& bag);
  /// Gives readings_ and tf_ all messages with stamps up to `time` plus max_age.
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
  /// For each problem, the number of frames that have it, and the first full text. The key is the
  /// text without its numbers.
  std::map<std::string, std::pair<std::size_t, std::string>> problems_;
  std::string shutter_;             // shutterReport() of the last frame with a motion
  std::optional<ImuMounting> imu_;  // the newest estimate of the Imu's mounting
  std::size_t frames_ = 0;
  std::size_t known_ = 0;
};

}  // namespace ktgp_orb::tools
