#include "ros/target_messages.h"

#include <ktgp_orb/MatchStatus.h>

#include <boost/make_shared.hpp>
#include <stdexcept>
#include <utility>

#include "ros/answer_message.h"
#include "ros/message_conversion.h"
#include "ros/pose_message.h"
#include "util/format.h"

namespace ktgp_orb {
namespace {

TargetDetection messageOf(const DetectedTarget& target) {
  TargetDetection message;
  message.id = target.id;
  message.instance = target.instance;
  message.status = static_cast<std::uint8_t>(target.status);
  message.uncertain = static_cast<std::uint8_t>(target.uncertain);
  message.image = static_cast<std::uint32_t>(target.image);
  message.image_width = static_cast<std::uint32_t>(target.image_size.width);
  message.image_height = static_cast<std::uint32_t>(target.image_size.height);
  for (std::size_t i = 0; i < target.corners.size(); ++i) {
    message.corners[2 * i] = target.corners[i].x();
    message.corners[2 * i + 1] = target.corners[i].y();
    Eigen::Map<Eigen::Matrix<double, 2, 2, Eigen::RowMajor>>(&message.corner_covariances[4 * i]) =
        target.corner_covariances[i];
  }
  copyAnswer(target.homography, message);
  message.inliers = static_cast<std::uint32_t>(target.inliers);
  message.log_false_alarms = target.log_false_alarms;
  message.age = static_cast<std::uint32_t>(target.age);
  message.predicted = target.predicted;
  message.width = target.width;
  message.frame = target.frame;
  message.ambiguity = target.ambiguity;
  return message;
}

/// Computes the camera from the camera_info. Throws std::invalid_argument, with the reason, if
/// there is no camera_info or it is unusable.
PixelCamera cameraOf(const cv::Size& image, const sensor_msgs::CameraInfo* info,
                     const std::string& info_topic, Pixels pixels) {
  if (info == nullptr) throw std::invalid_argument("no camera_info on " + info_topic);
  try {
    return pixelCamera(*info, pixels, image);
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(info_topic + " cannot be used: " + error.what());
  }
}

/// Name of the tf frame of this detection: instances after the first get a number.
std::string frameOf(const TargetDetection& target) {
  if (target.instance == 0 || target.frame.empty()) return target.frame;
  return target.frame + "_" + std::to_string(target.instance);
}

/// Throws std::invalid_argument if the target cannot have a pose: its frame is the camera's, or its
/// width is not known.
void requireFrameAndWidth(const TargetDetection& target, const std::string& camera_frame) {
  const std::string own_frame = frameOf(target);
  if (own_frame == camera_frame && !own_frame.empty()) {
    throw std::invalid_argument("the frame of instance " + std::to_string(target.instance) +
                                " of " + target.id + ", " + own_frame +
                                ", is the camera's; expected one of its own");
  }
  if (target.width > 0.0) return;
  const std::string frame =
      target.frame.empty() ? "" : ", which has the frame " + target.frame + ",";
  throw std::invalid_argument("the width of " + target.id + frame + " is not known");
}

}  // namespace

bool wantsPose(const TargetDetection& detection) {
  const bool wanted = detection.width > 0.0 || !detection.frame.empty();
  return detection.status == MatchStatus::STATUS_OK && wanted;
}

bool ImageSequence::next(const sensor_msgs::ImageConstPtr& image, const cv::Mat& grey,
                         TargetFinder& finder) {
  const ros::Time& stamp = image->header.stamp;
  if (last_ && repeats_.repeats(grey, stampOf(stamp), grey_, stampOf(stamp_))) return false;
  if (stamp < stamp_ || grey.size() != size_) finder.restart();
  stamp_ = stamp;
  size_ = grey.size();
  last_ = image;
  grey_ = grey;
  return true;
}

TargetDetectionsPtr toMessage(const std_msgs::Header& header, const TargetFrame& frame,
                              const std::string& frame_prefix) {
  auto message = boost::make_shared<TargetDetections>();
  message->header = header;
  for (const DetectedTarget& target : frame.detections) {
    message->detections.push_back(messageOf(target));
    std::string& name = message->detections.back().frame;
    if (!name.empty()) name = util::withoutSlash(name.insert(0, frame_prefix));
  }
  message->known = static_cast<std::uint32_t>(frame.known);
  message->candidates = static_cast<std::uint32_t>(frame.candidates);
  message->tried = static_cast<std::uint32_t>(frame.tried);
  message->frames_for_all = static_cast<std::uint32_t>(frame.frames_for_all);
  message->milliseconds = frame.milliseconds;
  message->at_limit = frame.at_limit;
  return message;
}

void addPoses(const TargetFrame& frame, const cv::Size& image, const sensor_msgs::CameraInfo* info,
              const std::string& info_topic, Pixels pixels, TargetPose& pose,
              TargetDetections& message) {
  const std::string camera_frame = util::withoutSlash(message.header.frame_id);
  std::optional<PixelCamera> camera;
  for (std::size_t i = 0; i < message.detections.size(); ++i) {
    TargetDetection& detection = message.detections[i];
    if (detection.status != MatchStatus::STATUS_OK) continue;
    try {
      requireFrameAndWidth(detection, camera_frame);
      if (!camera) camera = cameraOf(image, info, info_topic, pixels);
      const PlanarPoses found =
          pose.find(frame.detections[i], camera->camera, camera->lens.get(),
                    static_cast<std::int64_t>(message.header.stamp.toNSec()), image.height);
      if (found.poses.empty()) throw std::invalid_argument(detection.id + ": " + found.problem);
      const PlanarPose& best = found.poses.front();
      detection.has_pose = 1;
      detection.pose = toMessage(best.target_to_camera, best.covariance);
      detection.pose_share = best.share;
      if (found.poses.size() < 2) continue;
      const PlanarPose& other = found.poses.back();
      detection.other_pose = toMessage(other.target_to_camera, other.covariance);
    } catch (const std::invalid_argument& error) {
      if (wantsPose(detection) || message.no_pose.empty()) message.no_pose = error.what();
    }
  }
}

std::vector<geometry_msgs::TransformStamped> transformsOf(const TargetDetections& message) {
  std::vector<geometry_msgs::TransformStamped> transforms;
  std_msgs::Header header = message.header;
  header.frame_id = util::withoutSlash(header.frame_id);
  for (const TargetDetection& target : message.detections) {
    // If several poses are possible, send none to tf: tf can hold only one pose, and listeners
    // would not know that there are others.
    if (target.has_pose == 0 || target.frame.empty() || !target.ambiguity.empty()) continue;
    transforms.push_back(transformOf(header, frameOf(target), target.pose.pose));
  }
  // tf2 refuses a transform unless both frames have a name.
  if (header.frame_id.empty() && !transforms.empty()) {
    throw std::invalid_argument("the images have no frame_id, so " + transforms[0].child_frame_id +
                                " is not sent to tf; expected that of the camera");
  }
  return transforms;
}

visualization_msgs::MarkerArrayPtr markersOf(const TargetDetections& message) {
  using visualization_msgs::Marker;
  auto markers = boost::make_shared<visualization_msgs::MarkerArray>();
  Marker marker;
  marker.header = message.header;
  marker.action = Marker::DELETEALL;
  markers->markers.push_back(marker);
  marker.action = Marker::ADD;
  marker.color.r = marker.color.g = marker.color.a = 1.F;
  for (const TargetDetection& target : message.detections) {
    if (target.has_pose == 0) continue;
    const double height = target.width * target.image_height / target.image_width;
    marker.pose = target.pose.pose;
    marker.ns = "outline";
    marker.type = Marker::LINE_STRIP;
    marker.scale.x = 0.02 * target.width;
    marker.points.clear();
    for (const auto& [x, y] : {std::pair(-0.5, -0.5), std::pair(0.5, -0.5), std::pair(0.5, 0.5),
                               std::pair(-0.5, 0.5), std::pair(-0.5, -0.5)}) {
      geometry_msgs::Point corner;
      corner.x = x * target.width;
      corner.y = y * height;
      marker.points.push_back(corner);
    }
    markers->markers.push_back(marker);
    marker.ns = "id";
    marker.type = Marker::TEXT_VIEW_FACING;
    marker.points.clear();
    marker.text = target.id + " " + std::to_string(target.instance);
    marker.scale.z = 0.2 * height;
    markers->markers.push_back(marker);
    marker.text.clear();
    ++marker.id;
  }
  return markers;
}

}  // namespace ktgp_orb
