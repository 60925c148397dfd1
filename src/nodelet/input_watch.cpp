#include "nodelet/input_watch.h"

#include <ros/master.h>

#include <algorithm>

namespace ktgp_orb {
namespace {

constexpr int kSecondsBeforeWarning = 5;
constexpr int kSecondsBetweenWarnings = 30;

}  // namespace

std::string InputWatch::tick(bool subscribed, std::uint64_t arrived, std::uint32_t publishers) {
  silent_seconds_ = arrived == arrived_before_ ? silent_seconds_ + 1 : 0;
  arrived_before_ = arrived;
  if (!subscribed) {
    return silent_seconds_ == kSecondsBeforeWarning ? warningWithoutSubscription() : "";
  }
  if (silent_seconds_ % kSecondsBetweenWarnings != kSecondsBeforeWarning) return "";
  return "no image on " + topic_ + " for " + std::to_string(silent_seconds_) + " s (" +
         std::to_string(publishers) + " publishers, transport " + transport_ + ")";
}

// Not subscribed for want of subscribers, but a wrong topic name should show all the same.
std::string InputWatch::warningWithoutSubscription() const {
  ros::master::V_TopicInfo topics;
  if (!ros::master::getTopics(topics)) return "";
  const bool published = std::any_of(topics.begin(), topics.end(), [&](const auto& topic) {
    return topic.name == topic_ || topic.name == topic_ + "/" + transport_;
  });
  return published ? "" : "nobody publishes " + topic_ + ": is the topic name right?";
}

}  // namespace ktgp_orb
