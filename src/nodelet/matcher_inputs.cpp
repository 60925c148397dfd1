// The inputs of MatcherNodelet: images, while a result has a subscriber, and mask, reference and
// calibration.

#include <exception>
#include <string>
#include <utility>

#include "messages/camera.h"
#include "messages/image_conversion.h"
#include "nodelet/matcher_nodelet.h"

namespace ktgp_orb {
namespace {

using Lock = std::lock_guard<std::mutex>;

}  // namespace

void MatcherNodelet::subscribe() {
  new_subscription_ = true;
  image_sub_ = transport_->subscribe(image_topic_, queue_size_, &MatcherNodelet::imageArrived, this,
                                     *transport_hints_);
  listening_ = true;
  monitor_.setListening(true);
  subscribeCameraInfo();
}

void MatcherNodelet::unsubscribe() {
  image_sub_.shutdown();
  camera_info_sub_.shutdown();
  listening_ = false;
  newest_.clear();
  monitor_.setListening(false);
  const Lock lock(state_mutex_);
  requests_.forget_reference = true;
  requests_.fix_reference_after.reset();
}

void MatcherNodelet::imageArrived(const sensor_msgs::ImageConstPtr& image) {
  // If publisher and subscriber of one process start at the same time, ROS may connect them twice
  // and deliver everything twice: each frame would then be matched to itself.
  if (last_arrived_.lock() == image) return;
  last_arrived_ = image;
  monitor_.imageArrived();
  countLost(image->header.seq);
  const std::uint64_t number = ++arrivals_;
  if (paused_ || isSkipped(*image)) return;
  if (newest_.put({image, number})) monitor_.imageDropped();
}

bool MatcherNodelet::isSkipped(const sensor_msgs::Image& image) {
  rate_limiter_.setRate(max_rate_);
  const ros::Time& stamp = image.header.stamp;
  if (rate_limiter_.takes(stamp.isZero() ? ros::Time::now() : stamp)) return false;
  monitor_.imageSkipped();
  return true;
}

// Two publishers of one topic have separate counters, so gaps mean nothing.
void MatcherNodelet::countLost(std::uint32_t sequence_number) {
  if (new_subscription_.exchange(false) || publishers_ > 1) sequence_numbers_.restart();
  const std::uint32_t lost = sequence_numbers_.lostBefore(sequence_number);
  if (lost > 0 && !paused_) monitor_.imagesLost(lost);
}

void MatcherNodelet::subscribeSideInputs() {
  mask_sub_ = private_node_.subscribe("mask", 1, &MatcherNodelet::maskArrived, this);
  reference_sub_ = private_node_.subscribe("reference", 1, &MatcherNodelet::referenceArrived, this);
}

/// With connect_mutex_ locked.
void MatcherNodelet::subscribeCameraInfo() {
  const bool wanted = subscribed_ && configuration_.rectify;
  if (!wanted) camera_info_sub_.shutdown();
  if (!wanted || camera_info_sub_) return;
  camera_info_sub_ = node_.subscribe(camera_info_topic_, 1, &MatcherNodelet::cameraInfoArrived,
                                     this, ros::TransportHints().tcpNoDelay());
}

void MatcherNodelet::cameraInfoArrived(const sensor_msgs::CameraInfoConstPtr& info) {
  LensConstPtr lens;
  std::string problem;
  try {
    lens = lensFrom(*info);
  } catch (const std::exception& error) {
    problem = error.what();
  }
  const bool same_problem = problem == configuration_.lens_problem;
  if (!same_problem && !problem.empty()) {
    NODELET_WARN("%s cannot be used: %s", camera_info_topic_.c_str(), problem.c_str());
  }
  // camera_info comes with every image and rarely changes; an equal one is ignored.
  const bool same = lens && lens_ && lens->calibration() == lens_->calibration();
  if (same_problem && (same || lens == lens_)) return;
  if (!same) lens_ = lens;
  change([&](Configuration& configuration) {
    configuration.view.lens = configuration.rectify ? lens_ : nullptr;
    configuration.lens_problem = problem;
  });
}

void MatcherNodelet::maskArrived(const sensor_msgs::ImageConstPtr& image) {
  try {
    const cv::Mat mask = maskFrom(image);
    change([&mask](Configuration& configuration) { configuration.view.sent_mask = mask; });
  } catch (const RefusedImage& error) {
    NODELET_ERROR("the mask on %s is refused, the old one stays: %s", mask_sub_.getTopic().c_str(),
                  error.what());
  }
}

void MatcherNodelet::referenceArrived(const sensor_msgs::ImageConstPtr& image) {
  const bool none = image->width == 0 || image->height == 0;
  try {
    if (!none) greyImage(image, configuration_.stretch);  // refuses it here rather than later
  } catch (const RefusedImage& error) {
    NODELET_ERROR("the reference on %s is refused, the old one stays: %s",
                  reference_sub_.getTopic().c_str(), error.what());
    return;
  }
  change([&](Configuration& configuration) {
    configuration.reference_image = none ? file_reference_ : image;
  });
  if (configuration_.sequence.reference.mode != ReferenceMode::fixed) {
    NODELET_WARN("a reference arrived on %s; it is used when reference_mode is fixed",
                 reference_sub_.getTopic().c_str());
  }
}

// Once a second: the reference file may have changed. Unless `at_once`, it is read only after it
// has been stable for a second, since it may be half written.
void MatcherNodelet::rereadReference(bool at_once) {
  if (config_.reference_image.empty()) return;
  const FileState now = FileState::of(config_.reference_image);
  const bool settled = at_once || now == file_seen_;
  file_seen_ = now;
  if (now == file_state_ || !settled) return;
  file_state_ = now;
  try {
    const auto before =
        std::exchange(file_reference_, readImageFile("reference_image", config_.reference_image));
    change([&](Configuration& configuration) {
      // A reference from ~reference stays.
      if (configuration.reference_image == before) configuration.reference_image = file_reference_;
    });
    monitor_.setParameterError("");
    NODELET_INFO("reference_image %s has changed and was read again",
                 config_.reference_image.c_str());
  } catch (const std::exception& error) {
    monitor_.setParameterError(error.what());
    NODELET_ERROR("reference_image has changed, the old one stays: %s", error.what());
  }
}

// It asks the master, which may take long.
void MatcherNodelet::watchInput() {
  std::uint32_t publishers = 0;
  bool subscribed = false;
  {
    const Lock lock(connect_mutex_);
    subscribed = subscribed_;
    if (subscribed_) publishers = image_sub_.getNumPublishers();
  }
  publishers_ = publishers;
  watch(*image_watch_, subscribed, monitor_.arrived(), publishers);
  monitor_.setInputTrouble(image_watch_->trouble());
  monitor_.setMixture(watchMixture(publishers));
}

// Not in the services' queue: the updater reads a parameter, which blocks while the master does not
// answer.
void MatcherNodelet::report() {
  monitor_.tick(clockStands(), clockIsMissing());
  reportReference();
  diagnostics_->force_update();
}

// A frame that ~set_reference took is lost when the process ends. The master stores that there was
// one, so that the next process can report it.
void MatcherNodelet::reportReference() {
  const bool holds = holds_set_reference_;
  if (holds && !remembers_reference_) private_node_.setParam("reference_was_set", true);
  if (!holds && remembers_reference_) private_node_.deleteParam("reference_was_set");
  remembers_reference_ = holds;
  monitor_.setReferenceProblem(reference_lost_ ? kReferenceLost : "");
}

}  // namespace ktgp_orb
