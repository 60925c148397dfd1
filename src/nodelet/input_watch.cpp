#include "nodelet/input_watch.h"

#include <ros/master.h>
#include <ros/this_node.h>

#include <algorithm>
#include <set>
#include <utility>

#include "util/format.h"

namespace ktgp_orb {
namespace {

constexpr int kSecondsBetweenQuestions = 5;  // between queries to the master, if no message arrives
const char* const kImageType = "sensor_msgs/Image";
const char* const kCompressedType = "sensor_msgs/CompressedImage";

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
  XmlRpc::XmlRpcValue& publishers = state[0];  // a list: [[topic, [node, ...]], ...]
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

std::string noneOn(const std::string& what, const std::string& topic, const std::string& trouble) {
  return "no " + what + " on " + topic + (trouble.empty() ? "" : ": " + trouble);
}

InputWatch::InputWatch(std::string topic, std::string type, std::string what, std::string transport)
    : topic_(std::move(topic)),
      type_(std::move(type)),
      what_(std::move(what)),
      transport_(std::move(transport)) {}

std::string InputWatch::wanted() const {
  return transport_ == "raw" ? topic_ : topic_ + "/" + transport_;
}

void InputWatch::restart() {
  silent_seconds_ = 0;
  trouble_.clear();
  said_ = false;
}

std::string InputWatch::tick(bool subscribed, std::uint64_t arrived, std::uint32_t publishers) {
  const bool silent = arrived == arrived_before_ && subscribed == subscribed_;
  arrived_before_ = arrived;
  subscribed_ = subscribed;
  if (!silent) restart();
  if (!silent || ++silent_seconds_ % kSecondsBetweenQuestions != 0) return "";
  const std::string before = std::exchange(trouble_, askMaster());
  if (std::exchange(said_, true) && trouble_ == before) return "";
  // An idle node has not subscribed, so it is normal that nothing arrives. Report only what the
  // master says, for example that the topic name is wrong.
  if (!subscribed) return trouble_;
  return "no " + what_ + " on " + topic_ + " for " + std::to_string(silent_seconds_) + " s (" +
         std::to_string(publishers) + " publishers" +
         (type_ == kImageType ? ", transport " + transport_ : "") + ")" +
         (trouble_.empty() ? "" : ": " + trouble_);
}

std::string InputWatch::askMaster() const {
  ros::master::V_TopicInfo topics;
  if (!ros::master::getTopics(topics)) return "";
  const std::string name = wanted();
  const std::string type = typeOf(topics, name);
  if (!type.empty()) {
    if (transport_ != "raw" || type == type_) return "";
    std::string problem = name + " is of type " + type + "; expected " + type_;
    if (type == kCompressedType && type_ == kImageType) {
      problem += ", or the topic without its last part and that as image_transport";
    }
    return problem;
  }
  std::string problem = "no node publishes " + name + ": is the topic name right?";
  if (type_ != kImageType) return problem;
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
  return std::to_string(names.size()) + " nodes publish " + wanted() + " (" +
         util::joined(names, ", ") + "): their " + what_ +
         (type_ == kImageType ? "s are mixed" : " messages are mixed");
}

}  // namespace ktgp_orb
