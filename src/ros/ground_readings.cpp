#include "ros/ground_readings.h"

#include <ktgp_orb/MatchStatus.h>
#include <tf2/exceptions.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <stdexcept>
#include <utility>
#include <vector>

#include "motion/rows.h"
#include "ros/answer_message.h"
#include "ros/pose_message.h"
#include "ros/stamps.h"
#include "util/constants.h"
#include "util/format.h"

namespace ktgp_orb {
namespace {

constexpr double kDegree = util::kPi / 180.0;
using util::withoutSlash;

/// Inserts a message in the order of the stamps. If `order` finds that the stamp may be wrong (see
/// StampOrder), keeps the message in `apart` until the next message shows whether the stamp was
/// right.
template <typename Message>
void keep(const Message& message, util::StampOrder& order, std::deque<Message>& messages,
          std::optional<Message>& apart) {
  constexpr std::size_t kKept = 1000;  // messages
  const auto insert = [&messages](const Message& added) {
    const auto is_later = [&](const Message& other) {
      return other.header.stamp > added.header.stamp;
    };
    messages.insert(std::find_if_not(messages.rbegin(), messages.rend(), is_later).base(), added);
    if (messages.size() > kKept) messages.pop_front();
  };
  const util::StampOrder::Place place =
      order.next(static_cast<std::int64_t>(message.header.stamp.toNSec()));
  const std::optional<Message> before = std::exchange(apart, std::nullopt);
  if (place.was_one_ahead) messages.pop_back();
  if (place.restarted) messages.clear();
  if (place.was_one_ahead || place.restarted) insert(*before);
  if (place.is_apart) {
    apart = message;
  } else {
    insert(message);
  }
}

Eigen::Vector3d vector(const geometry_msgs::Vector3& v) {
  return {v.x, v.y, v.z};
}

// Standard deviations per axis that we assume for readings without a covariance. The first is for
// the direction of the ground from tf or an Imu, rad; the second is for the angular velocity from
// an Imu.
constexpr double kNormalDeviation = 0.5 * kDegree;
constexpr double kGyroDeviation = 0.5 * kDegree;  // rad/s

/// The largest standard deviation of the first `axes` axes. Returns `usual` if the covariance is
/// zero, because zero means "unknown" in sensor messages.
template <typename Covariance>
double deviationOf(const Covariance& covariance, std::size_t axes, double usual) {
  double largest = 0.0;
  for (std::size_t i = 0; i < axes; ++i) largest = std::max(largest, covariance[4 * i]);
  return largest > 0.0 ? std::sqrt(largest) : usual;
}

/// Returns the result of `read`. If `read` throws std::invalid_argument, returns nothing and sets
/// `why` to the reason.
template <typename Read>
auto attempt(const Read& read, std::string& why) -> decltype(read()) {
  why.clear();
  try {
    return read();
  } catch (const std::invalid_argument& error) {
    why = error.what();
    return std::nullopt;
  }
}

/// Throws if the reference and the image have different sizes: the reference then comes from
/// another camera, or is a drawn map, so its K is unknown. A size of zero means "unknown" and is
/// accepted.
void requireOneCamera(const HomographyStamped& h) {
  const bool is_known = h.image_width > 0 && h.reference_width > 0;
  if (!is_known || (h.reference_width == h.image_width && h.reference_height == h.image_height)) {
    return;
  }
  throw std::invalid_argument(
      util::format("the homographies are from a reference of %ux%u to images of %ux%u; expected a "
                   "reference by the same camera: for a map, use the pose of a target",
                   h.reference_width, h.reference_height, h.image_width, h.image_height));
}

}  // namespace

void GroundReadings::add(const sensor_msgs::Range& range) {
  keep(range, range_order_, ranges_, range_apart_);
}

void GroundReadings::add(const sensor_msgs::Imu& imu) {
  keep(imu, imu_order_, imus_, imu_apart_);
}

bool GroundReadings::complete(const std_msgs::Header& image) const {
  std::vector<std::string> frames;
  if (usesImu()) {
    // We wait for an Imu message that is newer than the image. A stamp far in the future is
    // probably wrong, so it does not prove that all earlier messages have arrived.
    const ros::Time latest = later(image.stamp, config_.max_age);
    const bool has_come = std::any_of(imus_.rbegin(), imus_.rend(), [&](const auto& imu) {
      return imu.header.stamp >= image.stamp && imu.header.stamp <= latest;
    });
    if (!has_come) return false;
    frames.push_back(imus_.back().header.frame_id);
  }
  if (usesRange() && !ranges_.empty()) frames.push_back(ranges_.back().header.frame_id);
  if (!config_.base_frame.empty()) frames.push_back(config_.base_frame);
  if (config_.height_source == "tf_height" || config_.normal_source == "tf_normal") {
    frames.push_back(config_.ground_frame);
  }
  const std::string camera = withoutSlash(image.frame_id);
  return std::all_of(frames.begin(), frames.end(), [&](const std::string& frame) {
    const std::string name = withoutSlash(frame);
    return name == camera || tf_.canTransform(name, camera, image.stamp);
  });
}

std::string GroundReadings::heightSource() const {
  if (config_.height_source == "range") return "the range on " + range_topic_;
  if (config_.height_source == "tf_height") return "tf, the plane z = 0 of " + config_.ground_frame;
  return "the parameter height, " + std::to_string(config_.height) + " m";
}

std::string GroundReadings::normalSource() const {
  const std::string gyro = config_.gyro ? ", and its angular velocity" : "";
  if (config_.normal_source == "imu") return "the orientation on " + imu_topic_ + gyro;
  const std::string turn = config_.gyro ? ", and the angular velocity on " + imu_topic_ : "";
  if (config_.normal_source == "tf_normal") return "tf, -z of " + config_.ground_frame + turn;
  if (config_.normal_source == "motion") return "the motion" + turn;
  return "straight down, -z of " +
         (config_.base_frame.empty() ? "the camera, its optical axis" : config_.base_frame) + turn;
}

Pose3 GroundReadings::transform(const std::string& target, const std::string& source,
                                const ros::Time& time) const {
  if (withoutSlash(target) == withoutSlash(source)) return Pose3::Identity();
  try {
    const auto found =
        tf_.lookupTransform(withoutSlash(target), withoutSlash(source), time).transform;
    Pose3 pose = Pose3::Identity();
    pose.linear() =
        Eigen::Quaterniond(found.rotation.w, found.rotation.x, found.rotation.y, found.rotation.z)
            .normalized()
            .toRotationMatrix();
    pose.translation() = vector(found.translation);
    return pose;
  } catch (const tf2::ExtrapolationException& error) {
    throw std::invalid_argument(util::format(
        "tf has %s at other times, and not within max_age, %.3f s, after the image came: %s",
        withoutSlash(source).c_str(), config_.max_age, error.what()));
  } catch (const tf2::TransformException& error) {
    throw std::invalid_argument(std::string("tf: ") + error.what());
  }
}

GroundMotionOptions GroundReadings::optionsFor(const std_msgs::Header& image) const {
  GroundMotionOptions options;
  options.readout_time = config_.readout_time;
  for (const std::string& other : {withoutSlash(image.frame_id), baseFrame(image, config_)}) {
    if (other != config_.odom_frame) continue;
    throw std::invalid_argument("odom_frame is " + other +
                                ", the frame of the camera; expected another one");
  }
  if (config_.height_source == "parameter") options.scale_deviation = config_.height_deviation;
  if (config_.base_frame.empty()) {
    // Without a base frame, we assume that the camera looks straight down, so that its rotation to
    // the level base frame is fixed.
    options.camera_to_base.linear() = Eigen::Vector3d(1.0, -1.0, -1.0).asDiagonal();
    return options;
  }
  try {
    options.camera_to_base = transform(config_.base_frame, image.frame_id, image.stamp);
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(std::string("where the camera is in base_frame is not known: ") +
                                error.what());
  }
  return options;
}

GroundFrame GroundReadings::frameOf(const HomographyStamped& h, const cv::Size& size,
                                    const sensor_msgs::CameraInfo& info, Pixels pixels) {
  GroundFrame frame;
  frame.stamp = static_cast<std::int64_t>(h.header.stamp.toNSec());
  frame.reference_stamp = static_cast<std::int64_t>(h.reference_stamp.toNSec());
  if (h.status == MatchStatus::STATUS_OK) {
    requireOneCamera(h);
    const PixelCamera camera = pixelCamera(info, h.rectified ? Pixels::rectified : pixels, size);
    if (camera.lens) {
      throw std::invalid_argument(
          "the images have lens distortion; expected homographies of images without: give the "
          "matcher image_rect, or set its parameter rectify");
    }
    frame.camera = camera.camera;
    frame.size = size;
    frame.answer = answerOf(h);
  }
  range_stamp_ = {};
  frame.height = attempt([&] { return height(h.header); }, no_height_);
  frame.down = attempt([&] { return down(h.header); }, no_normal_);
  dropSidewaysBeam(frame);
  frame.turn = attempt([&] { return turn(h.header); }, no_turn_);
  if (!image_order_.next(frame.stamp).is_apart) last_image_ = h.header.stamp;
  return frame;
}

/// Removes the height from the frame if the beam of the range sensor does not point to the ground,
/// because the distance to a wall, for example, is not a height.
void GroundReadings::dropSidewaysBeam(GroundFrame& frame) {
  if (!frame.height || !frame.down || !(frame.down->direction.z() > 0.0)) return;
  if (motion::meetsGround(*frame.height, frame.down->direction)) return;
  frame.height.reset();
  range_stamp_ = {};
  no_height_ =
      "the beam of the range on " + range_topic_ +
      " does not point to the ground; a range sensor looks along the x axis of its frame, " +
      range_frame_;
}

std::string GroundReadings::heightTrouble(const GroundEstimate& estimate) const {
  if (!(estimate.height_misfit > GroundEstimate::kContradiction)) return no_height_;
  return "that of " + heightSource() +
         " contradicts the homography: something is between the sensor and the ground, the ground "
         "is another one, or the sensor is wrong";
}

std::string GroundReadings::normalTrouble(const GroundEstimate& estimate) const {
  if (!(estimate.down_misfit > GroundEstimate::kContradiction)) return no_normal_;
  return "that of " + normalSource() +
         " contradicts the homography: the camera's or the sensor's place in tf, the stamps or the "
         "sensor itself may be wrong";
}

std::string GroundReadings::turnTrouble(const GroundEstimate& estimate) const {
  if (!(estimate.turn_misfit > GroundEstimate::kContradiction)) return no_turn_;
  const double ratio = estimate.turn_ratio;
  const std::string what = "the angular velocity on " + imu_topic_ + " contradicts the homography";
  if (ratio < -0.7) return what + ": it counts the other way; see where tf has the Imu";
  if (ratio > 40.0 && ratio < 75.0) return what + ": it is in degrees per second";
  // `ratio`: rotation measured by the Imu, divided by the rotation in the pictures. It is 1 if the
  // Imu's scale is right, and 0 while the camera has not turned enough. Noise alone changes it by
  // less than 0.02, so if it differs by more than kScale from both 0 and 1, the scale is wrong.
  constexpr double kScale = 0.04;
  if (std::abs(ratio) > kScale && std::abs(ratio - 1.0) > kScale) {
    return what + util::format(": it is %.2f times what the pictures show", ratio);
  }
  return what +
         ": its mounting in tf, its stamps, a bias or its noise may be wrong; \"Imu, as the "
         "pictures "
         "show it\" tells them apart after turns about all axes";
}

std::string GroundReadings::notUsed(const GroundEstimate& estimate) const {
  const std::string height = heightTrouble(estimate);
  if (!height.empty()) return "height: " + height;
  const std::string normal = normalTrouble(estimate);
  return normal.empty() ? turnTrouble(estimate) : "normal: " + normal;
}

GroundEstimate GroundReadings::withPatience(GroundEstimate estimate) {
  constexpr double kPatience = 1.0;  // s
  const bool used_readings = estimate.hasPose() || estimate.status == GroundStatus::no_normal;
  if (used_readings && !range_stamp_.isZero()) used_range_ = range_stamp_;
  if (estimate.height_used) last_height_ = last_image_;
  if (estimate.down_used || !usesNormal()) last_normal_ = last_image_;
  const auto is_old = [this](const ros::Time& last) {
    return last > last_image_ || secondsBetween(last, last_image_) > kPatience;
  };
  if (!estimate.hasPose()) return estimate;
  if (is_old(last_height_)) {
    estimate.status = GroundStatus::no_height;
  } else if (is_old(last_normal_)) {
    estimate.status = GroundStatus::no_normal;
  }
  return estimate;
}

std::string GroundReadings::problemOf(const GroundEstimate& estimate) const {
  switch (estimate.status) {
    case GroundStatus::no_homography:
      return "the matcher found no homography";
    case GroundStatus::no_covariance:
      return "the homography has no covariance, or one that is not positive definite";
    case GroundStatus::no_height: {
      // If an earlier frame has already used the newest reading, heightTrouble() returns no text.
      const std::string trouble = heightTrouble(estimate);
      return "no height: " + (trouble.empty() ? "no new reading yet" : trouble);
    }
    case GroundStatus::no_normal: {
      const std::string trouble = normalTrouble(estimate);
      return "no normal: " + (trouble.empty() ? "the motion does not show it yet" : trouble);
    }
    case GroundStatus::contradiction:
      return estimate.homography_misfit > GroundEstimate::kContradiction
                 ? "the homography is not that of flat ground: see the calibration, readout_time, "
                   "and what moves in the picture"
                 : "the homography is a jump after earlier frames: it may be off by a period of "
                   "repetitive ground";
    case GroundStatus::stamp_went_back:
      return "the stamp went back: the frame is left out, and if the next one goes back, too, the "
             "odometry begins anew";
    case GroundStatus::not_finite:
      return "numbers too large to compute with: the odometry begins anew";
    case GroundStatus::looks_away:
      return "the camera looks away from the ground, by " + normalSource() +
             ": check the mounting of camera and sensor in tf (is the Imu upside down?)";
    case GroundStatus::ok:
    case GroundStatus::started:
    case GroundStatus::resumed:
      break;
  }
  return "";
}

std::optional<HeightReading> GroundReadings::height(const std_msgs::Header& image) {
  if (config_.height_source == "range") return heightOfRange(image);
  HeightReading reading;
  reading.metres = config_.height;
  if (config_.height_source == "tf_height") {
    reading.metres = transform(config_.ground_frame, image.frame_id, image.stamp).translation().z();
  }
  reading.deviation = config_.height_deviation * std::abs(reading.metres);
  const std::string why = whyUnusable(reading);
  if (why.empty()) return reading;
  throw std::invalid_argument("the height of " + heightSource() + " " + why);
}

template <typename Message>
const Message& GroundReadings::nearest(const std::deque<Message>& messages, const std::string& what,
                                       const ros::Time& image) const {
  const auto found =
      std::min_element(messages.begin(), messages.end(), [&](const auto& a, const auto& b) {
        return std::abs(secondsBetween(image, a.header.stamp)) <
               std::abs(secondsBetween(image, b.header.stamp));
      });
  if (found == messages.end()) throw std::invalid_argument("no " + what);
  const double age = std::abs(secondsBetween(found->header.stamp, image));
  if (age <= config_.max_age) return *found;
  throw std::invalid_argument(
      util::format("the nearest %s is %.3f s away from the image; expected at most max_age, %.3f s",
                   what.c_str(), age, config_.max_age));
}

std::optional<HeightReading> GroundReadings::heightOfRange(const std_msgs::Header& image) {
  const sensor_msgs::Range& range = nearest(ranges_, "range on " + range_topic_, image.stamp);
  const double value = range.range;
  if (!(std::isfinite(value) && value > 0.0 && value >= range.min_range &&
        value <= range.max_range)) {
    throw std::invalid_argument("the range on " + range_topic_ + " is " + std::to_string(value) +
                                " m; expected a number above 0 within its limits, " +
                                std::to_string(range.min_range) + " to " +
                                std::to_string(range.max_range) + " m");
  }
  if (range.header.stamp == used_range_) return std::nullopt;  // use each reading only once
  HeightReading reading;
  reading.age = secondsBetween(range.header.stamp, image.stamp);
  reading.metres = value;
  reading.deviation = config_.height_deviation * reading.metres;
  reading.beam_direction = Eigen::Vector3d::UnitZ();
  if (withoutSlash(range.header.frame_id) != withoutSlash(image.frame_id)) {
    // complete() has waited for tf at the image's stamp. A later one may not be known yet.
    const Pose3 found =
        transform(image.frame_id, range.header.frame_id, std::min(range.header.stamp, image.stamp));
    reading.beam_origin = found.translation();
    reading.beam_direction = found.linear().col(0);  // a range sensor measures along its x axis
  }
  range_stamp_ = range.header.stamp;
  range_frame_ = range.header.frame_id;
  return reading;
}

std::optional<DownReading> GroundReadings::down(const std_msgs::Header& image) {
  if (config_.normal_source == "motion") return std::nullopt;
  if (config_.normal_source == "imu") return downOfImu(image);
  DownReading reading;
  reading.deviation = kNormalDeviation;
  const bool of_tf = config_.normal_source == "tf_normal";
  if (!of_tf && config_.base_frame.empty()) return reading;  // assume that the camera looks down
  const Pose3 found =
      transform(of_tf ? config_.ground_frame : config_.base_frame, image.frame_id, image.stamp);
  reading.direction = -found.linear().row(2).transpose();
  return reading;
}

/// For how many images, at the present rate of images, this message is the nearest one; at least 1.
double GroundReadings::usesOf(const sensor_msgs::Imu& imu, const std_msgs::Header& image) const {
  if (imus_.size() < 2 || last_image_.isZero() || image.stamp <= last_image_) return 1.0;
  const auto at = std::find_if(imus_.begin(), imus_.end(),
                               [&](const sensor_msgs::Imu& other) { return &other == &imu; });
  const auto before = at == imus_.begin() ? at : std::prev(at);
  const auto after = std::next(at) == imus_.end() ? at : std::next(at);
  const double sides = before == at || after == at ? 1.0 : 2.0;
  const double seconds = std::min(secondsBetween(before->header.stamp, after->header.stamp) / sides,
                                  2.0 * config_.max_age);
  return std::max(1.0, seconds / secondsBetween(last_image_, image.stamp));
}

DownReading GroundReadings::downOfImu(const std_msgs::Header& image) const {
  const sensor_msgs::Imu& imu = nearest(imus_, "Imu on " + imu_topic_, image.stamp);
  const double age = secondsBetween(imu.header.stamp, image.stamp);
  const Eigen::Quaterniond turn(imu.orientation.w, imu.orientation.x, imu.orientation.y,
                                imu.orientation.z);
  if (imu.orientation_covariance[0] < 0.0 || !(std::abs(turn.norm() - 1.0) < 0.01)) {
    throw std::invalid_argument("the Imu on " + imu_topic_ +
                                " has no orientation; expected a quaternion of length 1 and "
                                "orientation_covariance[0] other than -1");
  }
  const Pose3 found = transform(image.frame_id, imu.header.frame_id, image.stamp);
  DownReading reading;
  // An Imu that is slower than the camera gives several images the same error. Together, they must
  // count as one reading.
  reading.deviation =
      std::sqrt(usesOf(imu, image)) * deviationOf(imu.orientation_covariance, 2, kNormalDeviation);
  Eigen::Vector3d down = -turn.normalized().toRotationMatrix().row(2).transpose();
  const bool has_rate =
      imu.angular_velocity_covariance[0] >= 0.0 && vector(imu.angular_velocity).allFinite();
  if (has_rate) down -= age * vector(imu.angular_velocity).cross(down);
  reading.of_imu = true;
  reading.age = has_rate ? 0.0 : age;
  reading.direction = (found.linear() * down).normalized();
  return reading;
}

/// The rotation since the previous image, from the mean of all angular velocities in between.
std::optional<TurnReading> GroundReadings::turn(const std_msgs::Header& image) {
  if (!config_.gyro || last_image_.isZero() || image.stamp <= last_image_) return std::nullopt;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double count = 0.0;
  double ages = 0.0;  // sum of the times from each Imu message to the image, s
  double deviation = kGyroDeviation;
  std::string frame;
  std::string why = "no angular velocity on " + imu_topic_ + " between two images";
  for (const sensor_msgs::Imu& imu : imus_) {
    if (imu.header.stamp <= last_image_ || imu.header.stamp > image.stamp) continue;
    if (imu.angular_velocity_covariance[0] < 0.0) {
      why = "the angular_velocity_covariance on " + imu_topic_ +
            " begins with -1, so it has no angular velocity";
      continue;
    }
    if (!vector(imu.angular_velocity).allFinite()) {
      why = "the angular velocity on " + imu_topic_ + " has a number that is not finite";
      continue;
    }
    sum += vector(imu.angular_velocity);
    count += 1.0;
    ages += secondsBetween(imu.header.stamp, image.stamp);
    deviation = deviationOf(imu.angular_velocity_covariance, 3, kGyroDeviation);
    frame = imu.header.frame_id;
  }
  if (count == 0.0) throw std::invalid_argument(why);
  const Pose3 found = transform(image.frame_id, frame, image.stamp);
  const double length = secondsBetween(last_image_, image.stamp);
  const Eigen::Vector3d angles = found.linear() * (length / count * sum);
  TurnReading reading;
  reading.rotation = motion::rotationAbout(angles);
  reading.deviation = deviation * length;
  reading.age = ages / count - 0.5 * length;
  return reading;
}

std::string shutterReport(const GroundEstimate& estimate) {
  constexpr double kCertain = 5.0;  // standard deviations
  if (!(std::abs(estimate.readout_time) > kCertain * estimate.readout_deviation)) return "";
  return util::format("the shutter rolls: about %.1f ms from the %s",
                      1e3 * std::abs(estimate.readout_time),
                      estimate.readout_time > 0.0 ? "first row to the last"
                                                  : "last row to the first (images turned by 180 "
                                                    "degrees): readout_time is below 0");
}

std::string shutterTrouble(const GroundEstimate& estimate, double readout_time) {
  // The estimator assumes that a given readout_time is right within a standard deviation of a tenth
  // of this value, so it pulls the estimate towards the value. If they still differ by more than
  // three of these standard deviations (kShare: as a share of the value), and by more than kCertain
  // standard deviations of the estimate itself, the images clearly contradict the value.
  constexpr double kShare = 0.3;
  constexpr double kCertain = 5.0;
  if (readout_time == -1.0) return "";
  const double misfit = std::abs(estimate.readout_time - readout_time);
  const double least =
      std::max(kShare * std::abs(readout_time), kCertain * estimate.readout_deviation);
  if (!(misfit > least)) return "";
  return util::format(
      "readout_time is %.1f ms, but the pictures show %.1f ms or further from it: it is below 0 "
      "where the driver turns the images by 180 degrees; set -1 if you do not know it",
      1e3 * readout_time, 1e3 * estimate.readout_time);
}

}  // namespace ktgp_orb
