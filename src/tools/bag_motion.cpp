#include "tools/bag_motion.h"

#include <ktgp_orb/MatchStatus.h>
#include <tf2_msgs/TFMessage.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <regex>
#include <set>
#include <utility>
#include <vector>

#include "files/csv.h"
#include "ktgp_orb/status.h"
#include "ros/stamps.h"
#include "tools/bag_writer.h"
#include "util/counted.h"

namespace ktgp_orb::tools {
namespace {

constexpr const char* kPose[] = {"x", "y", "z", "roll", "pitch", "yaw"};
constexpr const char* kTwist[] = {"vx", "vy", "vz", "wx", "wy", "wz"};
// Number of columns: pose and twist, and for each of them 6 standard deviations and 15 covariances.
constexpr std::size_t kNumbers = 7 + 6 + 2 * (6 + 15);

std::string header() {
  std::string text = "stamp,status,x,y,z,qx,qy,qz,qw";
  for (const char* name : kTwist) text += std::string(",") + name;
  for (const auto& names : {kPose, kTwist}) {
    for (int i = 0; i < 6; ++i) text += std::string(",dev_") + names[i];
  }
  for (const auto& names : {kPose, kTwist}) {
    for (int i = 0; i < 6; ++i) {
      for (int j = i + 1; j < 6; ++j) text += std::string(",cov_") + names[i] + '_' + names[j];
    }
  }
  return text + ",reason\n";
}

/// Makes a row of the table. Unknown numbers are left empty. If `known` is empty, the frame was
/// refused, and `reason` says why.
std::string rowOf(const ros::Time& stamp, const std::optional<GroundEstimate>& known,
                  const std::string& reason) {
  files::CsvRow row;
  row.add(textOf(stamp)).add(known ? toString(known->status) : "refused");
  if (!known || !known->hasPose()) return row.skip(kNumbers).add(reason).line();
  const GroundEstimate& estimate = *known;
  const Eigen::Vector3d position = estimate.base_to_odometry.translation();
  const Eigen::Quaterniond turn(Eigen::Matrix3d(estimate.base_to_odometry.linear()));
  for (const double each :
       {position.x(), position.y(), position.z(), turn.x(), turn.y(), turn.z(), turn.w()}) {
    row.add(each);
  }
  const bool moves = estimate.hasTwist();
  const auto add_each = [&row](bool known, const auto& values) {
    if (!known) row.skip(6);
    for (int i = 0; known && i < 6; ++i) row.add(values(i));
  };
  const auto add_products = [&row](bool known, const Covariance6& covariance) {
    if (!known) row.skip(15);
    for (int i = 0; known && i < 6; ++i) {
      for (int j = i + 1; j < 6; ++j) row.add(covariance(i, j));
    }
  };
  add_each(moves, estimate.twist);
  add_each(true, estimate.pose_covariance.diagonal().cwiseSqrt());
  add_each(moves, estimate.twist_covariance.diagonal().cwiseSqrt());
  add_products(true, estimate.pose_covariance);
  add_products(moves, estimate.twist_covariance);
  return row.add(reason).line();
}

// Seconds; if the stamps go back by less than this, it is jitter or a single wrong stamp, not a
// clock that was set back.
constexpr double kWentBack = 1.0;

/// Returns true if the clock was set back before the message at `place`: the stamps of all messages
/// before it are more than kWentBack later than the stamps of all messages from it on. A single
/// wrong stamp, or one publisher whose stamps are in the future, does not count as a restart.
template <typename Message>
bool isRestart(const std::vector<Message>& messages, std::size_t place) {
  // Compare at most this many messages before `place` with at most this many from `place` on.
  constexpr std::size_t kAround = 100;
  constexpr std::size_t kLeast = 5;
  if (place < kLeast || place + kLeast > messages.size()) return false;
  const auto here = messages.begin() + static_cast<std::ptrdiff_t>(place);
  const auto is_earlier = [](const Message& a, const Message& b) {
    return a.header.stamp < b.header.stamp;
  };
  const auto begin = here - static_cast<std::ptrdiff_t>(std::min(place, kAround));
  const auto end = here + static_cast<std::ptrdiff_t>(std::min(messages.size() - place, kAround));
  const double before = std::min_element(begin, here, is_earlier)->header.stamp.toSec();
  const double after = std::max_element(here, end, is_earlier)->header.stamp.toSec();
  return before - after > kWentBack;
}

}  // namespace

template <typename Message>
BagMotion::Readings<Message>::Readings(const std::vector<Message>& arrived) {
  for (std::size_t i = 0; i < arrived.size(); ++i) {
    if (i == 0 || isRestart(arrived, i)) parts_.emplace_back();
    parts_.back().emplace(arrived[i].header.stamp, arrived[i]);
  }
}

template <typename Message>
template <typename Use>
void BagMotion::Readings<Message>::passUntil(const ros::Time& time, bool restarted,
                                             const Use& use) {
  if (restarted && goesOn()) parts_.pop_front();
  if (parts_.empty()) return;
  const auto end = parts_.front().upper_bound(time);
  std::for_each(parts_.front().begin(), end, [&use](const auto& each) { use(each.second); });
  parts_.front().erase(parts_.front().begin(), end);
}

void addMotionArguments(CLI::App& app, MotionFile& motion) {
  const char* const group = "Motion in metres (see doc/motion.md)";
  GroundMotionConfig& config = motion.config;
  CLI::Option* const table =
      app.add_option(
             "--motion", motion.path,
             "write a table with velocity and odometry of a camera that looks at the ground")
          ->type_name("FILE")
          ->group(group);
  const auto add = [&](const char* name, auto& value, const char* text = "") {
    return app.add_option(name, value, text)->capture_default_str()->needs(table)->group(group);
  };
  add("--motion_range", motion.range_topic,
      "topic of the range; without it: range beside the images");
  add("--motion_imu", motion.imu_topic, "topic of the Imu; without it: imu beside the images");
  for (CLI::Option* const parameter :
       {add("--motion_height_source", config.height_source), add("--motion_height", config.height),
        add("--motion_height_deviation", config.height_deviation),
        add("--motion_max_age", config.max_age), add("--motion_readout_time", config.readout_time),
        add("--motion_gyro", config.gyro), add("--motion_normal_source", config.normal_source),
        add("--motion_base_frame", config.base_frame)}) {
    tools::describe(parameter, "ground_motion");
  }
}

BagMotion::BagMotion(const MotionFile& options, const std::string& bag,
                     const std::string& image_topic,
                     const std::optional<sensor_msgs::CameraInfo>& camera)
    : options_(options) {
  if (options_.path.empty()) return;
  options_.config = usable(options_.config);
  const std::string beside = cameraOf(image_topic);
  if (options_.range_topic.empty()) options_.range_topic = beside + "/range";
  if (options_.imu_topic.empty()) options_.imu_topic = beside + "/imu";
  options_.range_topic = bag::topicName(options_.range_topic);
  options_.imu_topic = bag::topicName(options_.imu_topic);
  pixels_ = pixelsFrom(options_.config.calibration, image_topic);
  info_ = camera ? *camera : readCameraInfo(bag, image_topic, "--motion");
  readings_.configure(options_.config, options_.range_topic, options_.imu_topic);
  readMessages(bag);
}

namespace {

std::string ofAnotherType(const bag::Topic& topic, const std::string& expected) {
  return topic.name + " is of type " + topic.type + "; expected " + expected +
         (topic.type == expected ? " with the md5sum of this machine's" : "");
}

}  // namespace

/// Throws if a topic has the wrong type: otherwise it would look as if the topic had no messages.
void BagMotion::checkTypes(const std::string& path, const BagMessages& messages) const {
  const auto check = [&](const std::string& name, const char* type, const auto& is_right) {
    for (const bag::Topic& topic : messages.topics()) {
      if (topic.name != name || is_right(topic)) continue;
      throw UnusableBag(path + ": " + ofAnotherType(topic, type));
    }
  };
  if (readings_.usesRange()) {
    check(options_.range_topic, "sensor_msgs/Range", bag::isOf<sensor_msgs::Range>);
  }
  if (readings_.usesImu()) {
    check(options_.imu_topic, "sensor_msgs/Imu", bag::isOf<sensor_msgs::Imu>);
  }
}

void BagMotion::readMessages(const std::string& path) {
  const std::set<std::string> wanted{options_.range_topic, options_.imu_topic, "/tf", "/tf_static"};
  BagMessages messages(path);
  checkTypes(path, messages);
  messages.select([&wanted](const bag::Topic& topic) { return wanted.count(topic.name) > 0; });
  std::vector<sensor_msgs::Range> ranges;
  std::vector<sensor_msgs::Imu> imus;
  std::vector<geometry_msgs::TransformStamped> transforms;
  while (const auto message = messages.next()) {
    if (const auto range = message->as<sensor_msgs::Range>()) {
      ranges.push_back(*range);
    } else if (const auto imu = message->as<sensor_msgs::Imu>()) {
      imus.push_back(*imu);
    } else if (const auto tf = message->as<tf2_msgs::TFMessage>()) {
      const bool is_static = message->topic() == "/tf_static";
      for (const auto& each : tf->transforms) {
        if (is_static) tf_.setTransform(each, "bag", true);
        if (!is_static) transforms.push_back(each);
      }
    }
  }
  ranges_ = ranges;
  imus_ = imus;
  transforms_ = transforms;
}

void BagMotion::passOn(const ros::Time& time) {
  const ros::Time until = later(time, options_.config.max_age);
  const bool restarted = secondsBetween(time, last_) > kWentBack;
  if (restarted && transforms_.goesOn()) tf_.clear();
  last_ = time;
  ranges_.passUntil(until, restarted, [this](const auto& range) { readings_.add(range); });
  imus_.passUntil(until, restarted, [this](const auto& imu) { readings_.add(imu); });
  transforms_.passUntil(until, restarted,
                        [this](const auto& each) { tf_.setTransform(each, "bag"); });
}

void BagMotion::add(const HomographyStamped& homography, const cv::Size& image) {
  if (options_.path.empty()) return;
  ++frames_;
  passOn(homography.header.stamp);
  std::optional<GroundEstimate> estimate;
  std::string reason;
  try {
    motion_.setOptions(readings_.optionsFor(homography.header));
    estimate =
        readings_.withPatience(motion_.add(readings_.frameOf(homography, image, info_, pixels_)));
    if (homography.status != MatchStatus::STATUS_OK) {
      reason = toString(static_cast<Status>(homography.status));
    } else {
      reason = estimate->hasPose() ? readings_.notUsed(*estimate) : readings_.problemOf(*estimate);
    }
    if (estimate->hasPose()) {
      const std::string trouble = shutterTrouble(*estimate, options_.config.readout_time);
      shutter_ = trouble.empty() ? shutterReport(*estimate) : trouble;
    }
    if (estimate->imu) imu_ = estimate->imu;
  } catch (const std::invalid_argument& error) {
    reason = error.what();
  }
  const bool is_known = estimate && estimate->hasPose();
  if (is_known) ++known_;
  count(is_known, reason);
  rows_ += rowOf(homography.header.stamp, estimate, reason);
}

/// Counts how often a reason occurs. Reasons that differ only in numbers, such as a distance, count
/// as the same reason, but digits within a name distinguish them.
void BagMotion::count(bool is_known, const std::string& reason) {
  if (reason.empty()) return;
  static const std::regex number(R"((^|[ (])-?[0-9]+(\.[0-9]+)?)");
  const std::string text =
      (is_known ? " with motion, but not by all readings: " : " without: ") + reason;
  auto& [frames, first] = problems_[std::regex_replace(text, number, "$1")];
  if (frames++ == 0) first = text;
}

void BagMotion::close(files::Outputs& outputs) {
  if (!options_.path.empty()) outputs.writeText(options_.path, header() + rows_);
}

std::string BagMotion::report() const {
  if (options_.path.empty()) return "";
  std::string text = options_.path + ": motion of " + std::to_string(known_) + " of " +
                     util::counted(frames_, "frame") + ", height from " + readings_.heightSource() +
                     ", normal from " + readings_.normalSource() + '\n';
  if (!shutter_.empty()) text += "  " + shutter_ + '\n';
  if (imu_) {
    text += "  the Imu, as the pictures show it: " + describe(*imu_) + '\n';
    const std::string trouble = troubleOf(*imu_);
    if (!trouble.empty()) text += "  " + trouble + '\n';
  }
  std::vector<std::pair<std::size_t, std::string>> most;
  for (const auto& [key, problem] : problems_) most.push_back(problem);
  std::sort(most.rbegin(), most.rend());
  constexpr std::size_t kShown = 4;
  most.resize(std::min(most.size(), kShown));
  for (const auto& [frames, problem] : most) {
    text += "  " + util::counted(frames, "frame") + problem + '\n';
  }
  return text;
}

}  // namespace ktgp_orb::tools
