#include "nodelet/matcher_work.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "util/format.h"

namespace ktgp_orb {
namespace {

constexpr std::uint32_t kDataQueue = 10;  // number of messages that may wait for a slow subscriber

// An overlay is drawn at least this often, even if newer images are always waiting.
constexpr std::chrono::seconds kLongestWithoutOverlay{1};

}  // namespace

MatcherWork::MatcherWork(const Configuration& configuration, Outputs& outputs, Diagnosis& diagnosis,
                         std::function<bool()> newer_waits, std::string camera_info_topic,
                         MatcherFacts& facts)
    : matcher_(configuration),
      diagnosis_(diagnosis),
      newer_waits_(std::move(newer_waits)),
      camera_info_topic_(std::move(camera_info_topic)),
      facts_(facts) {
#define KTGP_TOPIC(name, Message, make, text) \
  addTopic<Message>(outputs, #name, [](const MatchedFrame& frame) { return make(frame); });
#define KTGP_LIVE_TOPIC KTGP_TOPIC
#include "ros/topics.def"
#undef KTGP_TOPIC
#undef KTGP_LIVE_TOPIC
  // Users of the picture only need the newest one, so its queue holds one message. The other topics
  // have longer queues, so that a slow subscriber loses no data.
  overlay_ = outputs.advertiseImage("matches_image", 1);
}

/// Adds a topic. `make` builds its message, and is called only while the topic has a subscriber.
template <typename Message, typename Make>
void MatcherWork::addTopic(Outputs& outputs, const std::string& name, Make make) {
  const ros::Publisher publisher = outputs.advertise<Message>(name, kDataQueue);
  topics_.emplace_back([publisher, make](const MatchedFrame& frame) {
    if (publisher.getNumSubscribers() == 0) return;
    if (const boost::shared_ptr<const Message> message = make(frame)) publisher.publish(message);
  });
}

void MatcherWork::process(const sensor_msgs::ImageConstPtr& image) {
  const auto start = Diagnosis::Clock::now();
  MatchedFrame frame = matcher_.process(image);
  if (frame.match.repeated) {
    diagnosis_.count(Diagnosis::kRepeated);
    return;
  }
  facts_.holds_set_reference = matcher_.holdsSetReference();
  report(frame.match);
  frame.dropped = diagnosis_.total(Diagnosis::kDropped);
  frame.lost = diagnosis_.total(Diagnosis::kLost);
  frame.skipped = diagnosis_.total(Diagnosis::kSkipped);
  frame.refused = diagnosis_.total(Diagnosis::kRefused);
  frame.repeated = diagnosis_.total(Diagnosis::kRepeated);
  frame.latency = diagnosis_.done(image->header.stamp, start);
  publish(frame);
  publishOverlay(image);
}

void MatcherWork::publish(const MatchedFrame& frame) {
  for (const auto& topic : topics_) topic(frame);
}

// Missing homographies only give a warning: a robot in front of a blank wall is not faulty.
void MatcherWork::report(const SequenceMatch& match) {
  const Status status = match.match.status;
  const bool has_reference = status != Status::no_reference;
  const cv::Size& size = match.frame->features.image_size;
  facts_.longer_side = std::max(size.width, size.height);
  without_reference_ = has_reference ? 0 : without_reference_ + 1;
  diagnosis_.count("frames matched", has_reference ? 1 : 0);
  diagnosis_.count("frames without reference", has_reference ? 0 : 1);
  const Status homography = match.match.homographyStatus();
  diagnosis_.count("geometries", status == Status::ok ? 1 : 0);
  diagnosis_.count("homographies", homography == Status::ok ? 1 : 0);
  diagnosis_.count("inliers", match.match.inliers);
  diagnosis_.count(kStillThings, has_reference && match.match.hasStillThings() ? 1 : 0);
  diagnosis_.setProblem("reference", referenceProblem(match), false);
  diagnosis_.setProblem("lens", lensProblem(match));
  // A frame without a reference has no geometry, and when the first one comes, camera_info may be
  // on its way. If a camera_info cannot be used, its arrival has logged the reason.
  if (has_reference) {
    diagnosis_.setProblem("camera", cameraProblem(match),
                          matcher_.configuration().camera_problem.empty());
  }
  if (!has_reference)
    diagnosis_.setValue("last reason for no reference", toString(match.no_reference));
  diagnosis_.setValue("views of the reference", toString(matcher_.viewsState()));
  diagnosis_.setValue("last status", toString(status));
  diagnosis_.setValue("last geometry", toString(match.match.geometry));
  facts_.finds_geometries = match.match.stage(StageId::two_view) != nullptr;
  if (facts_.finds_geometries) {
    const TwoView& view = match.match.two_view.view;
    diagnosis_.setValue("last parallax", util::format("%.2f degrees", view.parallax));
    diagnosis_.setValue("last doubt", toString(view.doubt));
  }
  if (has_reference && status != Status::ok) facts_.last_failure = status;
}

/// Returns how many frames in a row had no reference, and why. Every sequence begins with a frame
/// without a reference, so one such frame is no problem.
std::string MatcherWork::referenceProblem(const SequenceMatch& match) const {
  if (without_reference_ <= 1) return "";
  return util::format("%llu frames in a row without a reference: %s (%s)",
                      static_cast<unsigned long long>(without_reference_),
                      toString(match.no_reference), explanation(match.no_reference));
}

/// Returns the reason why points are in raw pixels although rectified points are wanted; empty if
/// there is no problem.
std::string MatcherWork::lensProblem(const SequenceMatch& match) const {
  const Configuration& configuration = matcher_.configuration();
  if (!configuration.rectify || match.frame->lens) return "";
  std::string reason = configuration.lens_problem;
  if (configuration.view.lens) {
    reason =
        "it is of " + util::text(configuration.view.lens->calibration().image_size) + " images";
  }
  return "rectify is on, but points are in raw pixels: no camera_info of a calibrated camera and "
         "of this image size on " +
         camera_info_topic_ + (reason.empty() ? "" : " (" + reason + ")");
}

/// Returns the reason why there is no motion although the two-view geometry is wanted; empty if
/// there is no problem.
std::string MatcherWork::cameraProblem(const SequenceMatch& match) const {
  const Configuration& configuration = matcher_.configuration();
  if (configuration.sequence.matcher.geometry == GeometryModel::homography) return "";
  if (match.frame->camera) return "";
  const std::string& reason = configuration.camera_problem;
  return "geometry is on, but there is no motion of the camera: no camera_info of a calibrated "
         "camera and of this image size on " +
         camera_info_topic_ + (reason.empty() ? "" : " (" + reason + ")");
}

// Called after the data are published, so that they do not wait until the picture is drawn.
void MatcherWork::publishOverlay(const sensor_msgs::ImageConstPtr& image) {
  if (overlay_.getNumSubscribers() == 0) return;
  const auto start = Diagnosis::Clock::now();
  if (newer_waits_() && start - last_overlay_ < kLongestWithoutOverlay) {
    diagnosis_.count("overlays skipped");
    return;
  }
  last_overlay_ = start;
  overlay_.publish(matcher_.overlay(image));
  diagnosis_.count("overlays");
}

}  // namespace ktgp_orb
