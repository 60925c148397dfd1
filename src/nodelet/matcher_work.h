#pragma once

#include <image_transport/image_transport.h>
#include <ros/ros.h>

#include <atomic>
#include <functional>
#include <string>
#include <vector>

#include "nodelet/diagnosis.h"
#include "nodelet/outputs.h"
#include "ros/message_matcher.h"

namespace ktgp_orb {

/// Name of the counter of frames in which things stand still although the scene moves
/// (MatchResult::still).
constexpr const char* kStillThings = "frames with things that stand still";

/// State that the worker shows to other threads.
struct MatcherFacts {
  std::atomic<bool> holds_set_reference{false};  ///< the reference came from ~set_reference
  std::atomic<int> longer_side{0};               ///< longer side of the last image, px
  std::atomic<Status> last_failure{
      Status::ok};  ///< status of the last frame that had a reference but failed
  std::atomic<bool> finds_geometries{false};  ///< whether two-view geometries are estimated, too
};

/// The worker's part of the matcher: matches images and publishes the topics that have subscribers.
/// Used only in the worker's thread.
class MatcherWork {
 public:
  /// `newer_waits`: returns true if an image newer than the current image has arrived.
  MatcherWork(const Configuration& configuration, Outputs& outputs, Diagnosis& diagnosis,
              std::function<bool()> newer_waits, std::string camera_info_topic,
              MatcherFacts& facts);

  void configure(const ConfigurationConstPtr& configuration) { matcher_.configure(*configuration); }
  const Configuration& configuration() const { return matcher_.configuration(); }
  void process(const sensor_msgs::ImageConstPtr& image);
  void forgetReference() { matcher_.forgetReference(); }
  void reset() {
    matcher_.reset();
    facts_.holds_set_reference = matcher_.holdsSetReference();
  }
  /// The next image becomes the fixed reference.
  void fixNextFrame() { matcher_.fixNextFrame(); }

 private:
  template <typename Message, typename Make>
  void addTopic(Outputs& outputs, const std::string& name, Make make);
  void report(const SequenceMatch& match);
  /// Not inlined, because robot_heap_test counts the allocations of ROS within this function.
  [[gnu::noinline]] void publish(const MatchedFrame& frame);
  std::string referenceProblem(const SequenceMatch& match) const;
  std::string lensProblem(const SequenceMatch& match) const;
  std::string cameraProblem(const SequenceMatch& match) const;
  void publishOverlay(const sensor_msgs::ImageConstPtr& image);

  MessageMatcher matcher_;
  Diagnosis& diagnosis_;
  std::function<bool()> newer_waits_;
  std::string camera_info_topic_;
  MatcherFacts& facts_;
  // functions that publish one topic each
  std::vector<std::function<void(const MatchedFrame&)>> topics_;
  image_transport::Publisher overlay_;
  Diagnosis::Clock::time_point last_overlay_;
  // Number of frames in a row without a reference, up to the newest frame.
  std::uint64_t without_reference_ = 0;
};

}  // namespace ktgp_orb
