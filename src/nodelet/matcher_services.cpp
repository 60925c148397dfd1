// The services of MatcherNodelet: they only store a request, except ~match_pair, which matches.

#include <boost/make_shared.hpp>
#include <exception>
#include <sstream>

#include "messages/image_conversion.h"
#include "nodelet/matcher_nodelet.h"

#include <ktgp_orb/MatchStatus.h>

namespace ktgp_orb {
namespace {

using Lock = std::lock_guard<std::mutex>;

void requireSize(const std::string& name, const sensor_msgs::Image& image, double most) {
  const double megapixels = 1e-6 * image.width * static_cast<double>(image.height);
  if (megapixels <= most) return;
  std::ostringstream text;
  text << name << " is " << image.width << "x" << image.height << " (" << megapixels
       << " megapixels); expected " << most << " at most (max_pair_megapixels)";
  throw RefusedImage(text.str());
}

}  // namespace

void MatcherNodelet::advertiseServices() {
  ros::NodeHandle node = getPrivateNodeHandle();
  node.setCallbackQueue(&service_queue_.callbacks);
  services_.push_back(node.advertiseService("reset", &MatcherNodelet::reset, this));
  services_.push_back(node.advertiseService("set_reference", &MatcherNodelet::setReference, this));
  services_.push_back(node.advertiseService("pause", &MatcherNodelet::pauseRequested, this));
  services_.push_back(node.advertiseService("resume", &MatcherNodelet::resumeRequested, this));
  ros::NodeHandle pair_node = getPrivateNodeHandle();
  pair_node.setCallbackQueue(&pair_queue_.callbacks);
  services_.push_back(pair_node.advertiseService("match_pair", &MatcherNodelet::matchPair, this));
}

bool MatcherNodelet::reset(Trigger::Request& /*request*/, Trigger::Response& response) {
  const Lock lock(state_mutex_);
  requests_.reset = true;
  requests_.fix_reference_after.reset();
  reference_lost_ = false;
  reset_timer_.stop();
  reset_timer_.start();
  response.success = true;
  response.message = "every reference is forgotten";
  return true;
}

bool MatcherNodelet::setReference(Trigger::Request& /*request*/, Trigger::Response& response) {
  const Lock lock(state_mutex_);
  response.message = whyNoReferenceCanBeSet();
  response.success = response.message.empty();
  if (!response.success) return true;
  requests_.fix_reference_after = arrivals_;
  response.message = "the next image becomes the fixed reference";
  return true;
}

/// Empty if it is possible. Call with state_mutex_ locked.
std::string MatcherNodelet::whyNoReferenceCanBeSet() {
  if (configuration_.sequence.reference.mode != ReferenceMode::fixed) {
    return "reference_mode is not fixed; set it first";
  }
  if (paused_) return "paused: images are ignored; call resume first";
  if (!listening_) return "idle: no image is received, since no output has a subscriber";
  return "";
}

bool MatcherNodelet::pauseRequested(Trigger::Request& /*request*/, Trigger::Response& response) {
  pause();
  response.success = true;
  response.message = "images are ignored until resumed";
  return true;
}

bool MatcherNodelet::resumeRequested(Trigger::Request& /*request*/, Trigger::Response& response) {
  resume();
  response.success = true;
  response.message = "images are matched again";
  return true;
}

void MatcherNodelet::pause() {
  paused_ = true;
  newest_.clear();
  monitor_.setPaused(true);
}

void MatcherNodelet::resume() {
  paused_ = false;
  monitor_.setPaused(false);
}

bool MatcherNodelet::matchPair(MatchPair::Request& request, MatchPair::Response& response) {
  Configuration configuration;
  {
    const Lock lock(state_mutex_);
    configuration = configuration_;
  }
  configuration.sequence.reference.mode = ReferenceMode::fixed;
  configuration.view = {};  // of the camera; the two images may come from elsewhere
  configuration.reference_image = boost::make_shared<sensor_msgs::Image>(request.reference);
  const char* image = "";  // prefix for errors that do not name the image
  try {
    requireSize("reference", request.reference, configuration.max_pair_megapixels);
    requireSize("target", request.target, configuration.max_pair_megapixels);
    image = "reference: ";
    MessageMatcher matcher(configuration);
    image = "target: ";
    const FrameMessages messages =
        matcher.process(boost::make_shared<sensor_msgs::Image>(request.target));
    response.correspondences = *messages.correspondences;
    response.homography = *messages.homography;
    response.statistics = *messages.statistics;
    response.success = true;
  } catch (const std::exception& error) {
    response.success = false;
    response.message = std::string(image) + error.what();
    response.homography.status = MatchStatus::STATUS_NO_REFERENCE;
    response.statistics.status = MatchStatus::STATUS_NO_REFERENCE;
  }
  return true;
}

}  // namespace ktgp_orb
