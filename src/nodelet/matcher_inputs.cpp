// What comes in to MatcherNodelet: images while anyone wants a result, and what says how to look at
// them.

#include <exception>
#include <string>
#include <utility>

#include "messages/image_conversion.h"
#include "nodelet/matcher_nodelet.h"

namespace ktgp_orb {
namespace {

using Lock = std::lock_guard<std::mutex>;

}  // namespace

void MatcherNodelet::connectionsChanged() {
  const Lock lock(connect_mutex_);
  if (!advertised_) return;
  const bool wanted = anySubscriber();
  if (wanted && !subscribed_) subscribe();
  if (!wanted && subscribed_) unsubscribe();
}

void MatcherNodelet::subscribe() {
  new_subscription_ = true;
  image_sub_ = transport_->subscribe("image", queue_size_, &MatcherNodelet::imageArrived, this,
                                     *transport_hints_);
  subscribed_ = listening_ = true;
  input_silence_begins_ = true;
  monitor_.setListening(true);
  subscribeCameraInfo();
  target_.listen(true);
}

void MatcherNodelet::unsubscribe() {
  image_sub_.shutdown();
  camera_info_sub_.shutdown();
  target_.listen(false);
  subscribed_ = listening_ = false;
  input_silence_begins_ = true;
  newest_.clear();
  monitor_.setListening(false);
  const Lock lock(state_mutex_);
  requests_.forget_reference = true;
  requests_.fix_reference_after.reset();
}

void MatcherNodelet::imageArrived(const sensor_msgs::ImageConstPtr& image) {
  // Where publisher and subscriber of one process start at the same time, ROS may link them twice
  // and deliver everything twice: each frame would then be matched to itself.
  if (last_arrived_.lock() == image) return;
  last_arrived_ = image;
  monitor_.imageArrived();
  countLost(image->header.seq);
  const std::uint64_t number = ++arrivals_;
  if (paused_ || isSkipped(*image)) return;
  if (newest_.put({image, number})) monitor_.imagesDropped(1);
}

bool MatcherNodelet::isSkipped(const sensor_msgs::Image& image) {
  rate_limiter_.setRate(max_rate_);
  const ros::Time& stamp = image.header.stamp;
  if (rate_limiter_.takes(stamp.isZero() ? ros::Time::now() : stamp)) return false;
  monitor_.imageSkipped();
  return true;
}

// Two publishers of one topic count each for itself: then nothing can be said.
void MatcherNodelet::countLost(std::uint32_t sequence_number) {
  if (new_subscription_.exchange(false) || publishers_ > 1) sequence_numbers_.restart();
  const std::uint32_t lost = sequence_numbers_.lostBefore(sequence_number);
  if (lost > 0 && !paused_) monitor_.imagesDropped(lost);
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
  camera_info_sub_ =
      node_.subscribe(camera_info_topic_, 1, &MatcherNodelet::cameraInfoArrived, this);
}

void MatcherNodelet::cameraInfoArrived(const sensor_msgs::CameraInfoConstPtr& info) {
  LensConstPtr lens;
  std::string problem;
  try {
    lens = lensFrom(*info);
  } catch (const std::exception& error) {
    problem = error.what();
  }
  if (problem != lens_problem_ && !problem.empty()) {
    NODELET_WARN("%s cannot be used: %s", camera_info_topic_.c_str(), problem.c_str());
  }
  lens_problem_ = problem;
  // It comes with every image and is nearly always the same: then the old one stays.
  const bool same = lens && lens_ && lens->calibration() == lens_->calibration();
  if (same || lens == lens_) return;
  lens_ = lens;
  change([this](Configuration& configuration) {
    configuration.view.lens = configuration.rectify ? lens_ : nullptr;
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
    NODELET_WARN("a reference came on %s; it counts when reference_mode is fixed",
                 reference_sub_.getTopic().c_str());
  }
}

// It asks the master, which may take long.
void MatcherNodelet::watchInput() {
  // A paused bag is no broken camera; a clock that never began is.
  if (clock_stands_ && !ros::Time::now().isZero()) return;
  std::uint32_t publishers = 0;
  bool subscribed = false;
  {
    const Lock lock(connect_mutex_);
    subscribed = subscribed_;
    if (subscribed_) publishers = image_sub_.getNumPublishers();
  }
  publishers_ = publishers;
  if (input_silence_begins_.exchange(false)) input_watch_->restart();
  const std::string warning = input_watch_->tick(subscribed, monitor_.arrived(), publishers);
  if (!warning.empty()) NODELET_WARN("%s", warning.c_str());
}

// Not in the services' queue: the updater reads a parameter, which waits for a master that is held
// up.
void MatcherNodelet::report() {
  clock_stands_ = clockStands();
  monitor_.tick(clock_stands_);
  diagnostics_->force_update();
}

bool MatcherNodelet::clockStands() {
  if (!ros::Time::isSimTime()) return false;
  const ros::Time now = ros::Time::now();
  return now == std::exchange(last_report_, now);
}

}  // namespace ktgp_orb
