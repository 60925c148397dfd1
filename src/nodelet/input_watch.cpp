#include "nodelet/input_watch.h"

#include <ros/master.h>

#include <algorithm>

namespace ktgp_orb {
namespace {

constexpr int kSecondsBeforeWarning = 5;
constexpr int kSecondsBetweenWarnings = 30;
const char* const kImage = "sensor_msgs/Image";
const char* const kCompressed = "sensor_msgs/CompressedImage";

/// Type of a topic that somebody publishes; empty: nobody does.
std::string typeOf(const ros::master::V_TopicInfo& topics, const std::string& name) {
  const auto found = std::find_if(topics.begin(), topics.end(),
                                  [&name](const auto& topic) { return topic.name == name; });
  return found == topics.end() ? "" : found->datatype;
}

}  // namespace

std::string InputWatch::tick(bool subscribed, std::uint64_t arrived, std::uint32_t publishers) {
  silent_seconds_ = arrived == arrived_before_ ? silent_seconds_ + 1 : 0;
  arrived_before_ = arrived;
  if (!subscribed) {
    // For want of subscribers, but a wrong topic name should show all the same.
    return silent_seconds_ == kSecondsBeforeWarning ? trouble() : "";
  }
  if (silent_seconds_ % kSecondsBetweenWarnings != kSecondsBeforeWarning) return "";
  const std::string reason = trouble();
  return "no image on " + topic_ + " for " + std::to_string(silent_seconds_) + " s (" +
         std::to_string(publishers) + " publishers, transport " + transport_ + ")" +
         (reason.empty() ? "" : ": " + reason);
}

std::string InputWatch::trouble() const {
  ros::master::V_TopicInfo topics;
  if (!ros::master::getTopics(topics)) return "";
  const std::string wanted = transport_ == "raw" ? topic_ : topic_ + "/" + transport_;
  const std::string type = typeOf(topics, wanted);
  if (!type.empty()) {
    if (transport_ != "raw" || type == kImage) return "";
    std::string problem = wanted + " is of type " + type + "; expected " + kImage;
    if (type == kCompressed) {
      problem += ", or the topic without its last part and that as image_transport";
    }
    return problem;
  }
  std::string problem = "nobody publishes " + wanted + ": is the topic name right?";
  for (const std::string other : {"raw", "compressed"}) {
    const std::string name = other == "raw" ? topic_ : topic_ + "/" + other;
    if (name == wanted || typeOf(topics, name).empty()) continue;
    problem.append(" There is ").append(name).append(", for image_transport ").append(other);
    break;
  }
  return problem;
}

}  // namespace ktgp_orb
