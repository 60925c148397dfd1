#include "nodelet/input_watch.h"

#include <ros/master.h>
#include <ros/this_node.h>

#include <algorithm>
#include <set>
#include <utility>

namespace ktgp_orb {
namespace {

constexpr int kSecondsBeforeWarning = 5;
constexpr int kSecondsBetweenWarnings = 30;
const char* const kImage = "sensor_msgs/Image";
const char* const kCompressed = "sensor_msgs/CompressedImage";

/// Type of a published topic; empty if it has no publisher.
std::string typeOf(const ros::master::V_TopicInfo& topics, const std::string& name) {
  const auto found = std::find_if(topics.begin(), topics.end(),
                                  [&name](const auto& topic) { return topic.name == name; });
  return found == topics.end() ? "" : found->datatype;
}

/// Names of the nodes that publish a topic.
std::set<std::string> publishersOf(const std::string& topic) {
  XmlRpc::XmlRpcValue request;
  XmlRpc::XmlRpcValue response;
  XmlRpc::XmlRpcValue state;
  request[0] = ros::this_node::getName();
  if (!ros::master::execute("getSystemState", request, response, state, false)) return {};
  std::set<std::string> names;
  XmlRpc::XmlRpcValue& publishers = state[0];  // [[topic, [node, ...]], ...]
  // NOLINTNEXTLINE(modernize-loop-convert): values of XML-RPC are not iterated everywhere
  for (int i = 0; i < publishers.size(); ++i) {
    if (static_cast<std::string>(publishers[i][0]) != topic) continue;
    XmlRpc::XmlRpcValue& nodes = publishers[i][1];
    // NOLINTNEXTLINE(modernize-loop-convert)
    for (int j = 0; j < nodes.size(); ++j) names.insert(nodes[j]);
  }
  return names;
}

}  // namespace

InputWatch::InputWatch(std::string topic, std::string transport)
    : InputWatch(std::move(topic), std::move(transport), kImage, "image") {}

InputWatch::InputWatch(std::string topic, std::string transport, std::string type, std::string what)
    : topic_(std::move(topic)),
      transport_(std::move(transport)),
      type_(std::move(type)),
      what_(std::move(what)) {}

InputWatch InputWatch::ofMessages(std::string topic, std::string type, std::string what) {
  return {std::move(topic), "raw", std::move(type), std::move(what)};
}

std::string InputWatch::wanted() const {
  return transport_ == "raw" ? topic_ : topic_ + "/" + transport_;
}

std::string InputWatch::tick(bool subscribed, std::uint64_t arrived, std::uint32_t publishers) {
  silent_seconds_ = arrived == arrived_before_ ? silent_seconds_ + 1 : 0;
  arrived_before_ = arrived;
  if (!subscribed) {
    // The publisher is idle without subscribers, but a wrong topic name should be reported all the
    // same.
    return silent_seconds_ == kSecondsBeforeWarning ? trouble() : "";
  }
  if (silent_seconds_ % kSecondsBetweenWarnings != kSecondsBeforeWarning) return "";
  const std::string reason = trouble();
  return "no " + what_ + " on " + topic_ + " for " + std::to_string(silent_seconds_) + " s (" +
         std::to_string(publishers) + " publishers" +
         (type_ == kImage ? ", transport " + transport_ : "") + ")" +
         (reason.empty() ? "" : ": " + reason);
}

std::string InputWatch::trouble() const {
  ros::master::V_TopicInfo topics;
  if (!ros::master::getTopics(topics)) return "";
  const std::string name = wanted();
  const std::string type = typeOf(topics, name);
  if (!type.empty()) {
    if (transport_ != "raw" || type == type_) return "";
    std::string problem = name + " is of type " + type + "; expected " + type_;
    if (type == kCompressed && type_ == kImage) {
      problem += ", or the topic without its last part and that as image_transport";
    }
    return problem;
  }
  std::string problem = "nobody publishes " + name + ": is the topic name right?";
  if (type_ != kImage) return problem;
  for (const std::string other : {"raw", "compressed"}) {
    const std::string sibling = other == "raw" ? topic_ : topic_ + "/" + other;
    if (sibling == name || typeOf(topics, sibling).empty()) continue;
    problem.append(" There is ").append(sibling).append(", for image_transport ").append(other);
    break;
  }
  return problem;
}

std::string InputWatch::mixture(std::uint32_t publishers) const {
  if (publishers < 2) return "";
  const std::set<std::string> names = publishersOf(wanted());
  if (names.size() < 2) return "";
  std::string text = std::to_string(names.size()) + " nodes publish " + wanted() + " (";
  for (const std::string& name : names) text += (name == *names.begin() ? "" : ", ") + name;
  return text + "): their " + what_ + (type_ == kImage ? "s are mixed" : " messages are mixed");
}

}  // namespace ktgp_orb
