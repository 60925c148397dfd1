#include <image_transport/camera_common.h>
#include <ktgp_orb/KtgpConfig.h>
#include <ktgp_orb/MatchPair.h>
#include <ktgp_orb/MatchStatus.h>
#include <std_srvs/Trigger.h>
#include <pluginlib/class_list_macros.hpp>

#include <atomic>
#include <boost/make_shared.hpp>
#include <stdexcept>

#include "matching/standing/standing.h"
#include "nodelet/image_node.h"
#include "nodelet/matcher_settings.h"
#include "nodelet/matcher_work.h"
#include "ros/image_conversion.h"
#include "ros/rate_limiter.h"
#include "util/format.h"

namespace ktgp_orb {
namespace {

using std_srvs::Trigger;

constexpr const char* kReferenceLost =
    "the reference that ~set_reference took is lost, since the process that had it ended: call "
    "~set_reference again, or ~reset";

// We warn if a geometry is found in less than this share of the frames, or if things that stand
// still are found in more than this share.
constexpr double kMinShare = 0.5;

}  // namespace

/// Publishes matches and homographies of images. doc/topics.md describes topics and services.
///
/// MatcherSettings is used only in the settings queue, and MatcherWork only in the worker; jobs
/// pass the configuration from one to the other.
class MatcherNodelet : public ImageNode<KtgpConfig, MatcherWork> {
 public:
  ~MatcherNodelet() override { stop(); }

 private:
  void start() override;
  void advertise() override;
  void advertiseServices();
  std::string nodelet() const override { return "matcher"; }
  std::string workName() const override { return "matcher"; }
  std::string greeting() const override;
  bool isWanted() const override { return !lazy_ || outputs_.haveSubscribers(); }
  void listeningChanged(bool listening) override;
  void beforeReport() override;
  void configure(KtgpConfig& config) override;

  void imageArrived(const sensor_msgs::ImageConstPtr& image);
  void sendConfiguration();
  template <typename Use>
  void use(const std::string& what, const Use& use);
  void lensArrived(const sensor_msgs::CameraInfo& info);
  void cameraArrived(const sensor_msgs::CameraInfoConstPtr& info);
  void rereadReference(bool at_once);
  void matchPair(MatchPair::Request& request, MatchPair::Response& response);
  void setReference();

  static constexpr std::size_t kImage = 1;  // kinds of jobs of the worker
  static constexpr std::size_t kConfiguration = 2;

  // Set by start()
  ImageInput* images_ = nullptr;
  Input* camera_info_ = nullptr;
  ros::Subscriber mask_;
  ros::Subscriber reference_;

  MatcherSettings settings_;          // used only in the settings queue
  RateLimiter rate_limiter_;          // used only in the data queue
  bool remembers_reference_ = false;  // used only in the slow queue

  std::atomic<bool> lazy_{true};
  std::atomic<double> max_rate_{0.0};  // Hz
  std::atomic<bool> is_fixed_{false};  // whether reference_mode is "fixed"
  MatcherFacts facts_;
};

void MatcherNodelet::start() {
  images_ = &addImages(1, [this](const sensor_msgs::ImageConstPtr& image, std::uint32_t /*lost*/) {
    imageArrived(image);
  });
  camera_info_ = &addInput<sensor_msgs::CameraInfo>(
      image_transport::getCameraInfoTopic(images_->topic()), "camera_info", 1, false,
      [this](const sensor_msgs::CameraInfoConstPtr& info) {
        if (config_.rectify) lensArrived(*info);
        cameraArrived(info);
      },
      &settings_queue_);
  worker_.setLimits(kImage, 1);
  worker_.setLimits(kConfiguration, 1);
  serveParameters();
}

std::string MatcherNodelet::greeting() const {
  return "matches images on " + images_->topic() + " (transport " + images_->transport() + ")" +
         (lazy_ ? " while " + getPrivateNodeHandle().getNamespace() + "/* has subscribers" : "");
}

void MatcherNodelet::advertise() {
  startWorker(std::make_unique<MatcherWork>(
      settings_.configuration(), outputs_, diagnosis_, [this] { return worker_.has(kImage); },
      camera_info_->topic(), facts_));
  advertiseServices();
  ros::NodeHandle settings = privateNode(settings_queue_);
  if (settings.deleteParam("reference_was_set") && is_fixed_) {
    diagnosis_.setFault("lost reference", kReferenceLost);
  }
  mask_ = settings.subscribe<sensor_msgs::Image>(
      "mask", 1, [this](const sensor_msgs::ImageConstPtr& image) {
        use("the mask on " + mask_.getTopic(), [&] { settings_.setMask(image); });
      });
  reference_ = settings.subscribe<sensor_msgs::Image>(
      "reference", 1, [this](const sensor_msgs::ImageConstPtr& image) {
        use("the reference on " + reference_.getTopic(), [&] {
          settings_.setReference(image);
          diagnosis_.setFault("lost reference", "");
        });
        if (!is_fixed_) {
          NODELET_WARN("a reference arrived on %s; it is used when reference_mode is fixed",
                       reference_.getTopic().c_str());
        }
      });
  addTimer(settings_queue_, 1.0, [this] { rereadReference(false); });
}

void MatcherNodelet::advertiseServices() {
  addService<Trigger>("reset", service_queue_, [this](auto& /*request*/, auto& response) {
    worker_.post([](MatcherWork& work) { work.reset(); });
    diagnosis_.setFault("lost reference", "");
    settings_queue_.post([this] { rereadReference(true); });
    response.message = "every reference is forgotten";
  });
  addService<Trigger>("set_reference", service_queue_, [this](auto& /*request*/, auto& response) {
    setReference();
    response.message = "the next image becomes the fixed reference";
  });
  addService<Trigger>("pause", service_queue_, [this](auto& /*request*/, auto& response) {
    paused_ = true;
    worker_.clear(kImage);
    diagnosis_.setPaused(true);
    response.message = "images are ignored until resumed";
  });
  addService<Trigger>("resume", service_queue_, [this](auto& /*request*/, auto& response) {
    paused_ = false;
    diagnosis_.setPaused(false);
    response.message = "images are matched again";
  });
  addService<MatchPair>("match_pair", long_queue_,
                        [this](auto& request, auto& response) { matchPair(request, response); });
}

void MatcherNodelet::listeningChanged(bool listening) {
  if (listening) return;
  worker_.clear(kImage);
  worker_.post([](MatcherWork& work) { work.forgetReference(); });
}

void MatcherNodelet::imageArrived(const sensor_msgs::ImageConstPtr& image) {
  if (paused_) return;
  rate_limiter_.setRate(max_rate_);
  const ros::Time& stamp = image->header.stamp;
  if (!rate_limiter_.takes(stamp.isZero() ? ros::Time::now() : stamp)) {
    diagnosis_.count(Diagnosis::kSkipped);
    return;
  }
  diagnosis_.count(Diagnosis::kDropped, worker_.put<&MatcherWork::process>(kImage, 0, image));
}

void MatcherNodelet::configure(KtgpConfig& config) {
  settings_.configure(config, images_->topic());
  const std::string on_fixed = noteOnFixed(parametersFrom(config));
  const bool is_anew = !isConfigured() || config.reference_mode != config_.reference_mode;
  if (is_anew && !on_fixed.empty()) NODELET_INFO("%s", on_fixed.c_str());
  diagnosis_.setMaxLatency(config.max_latency);
  max_rate_ = config.max_rate;
  lazy_ = config.lazy;
  is_fixed_ = settings_.configuration().sequence.reference.mode == ReferenceMode::fixed;
  camera_info_->enable(config.rectify || settings_.configuration().sequence.matcher.geometry !=
                                             GeometryModel::homography);
  if (!is_fixed_) diagnosis_.setFault("lost reference", "");
  sendConfiguration();
  // The parameters lazy and rectify may have changed, and with them the inputs that are needed.
  connectionsChanged();
}

/// Sends the configuration to the worker, where it takes effect as a whole between two frames. A
/// newer configuration replaces an older configuration that still waits.
void MatcherNodelet::sendConfiguration() {
  const ConfigurationConstPtr configuration =
      boost::make_shared<Configuration>(settings_.configuration());
  const std::string file = idleMask(configuration->view.file_mask);
  const std::string sent = idleMask(configuration->view.sent_mask);
  diagnosis_.setFault("mask_image", file.empty() ? "" : "mask_image " + file);
  diagnosis_.setFault("mask", sent.empty() ? "" : "the mask on " + mask_.getTopic() + " " + sent);
  worker_.put<&MatcherWork::configure>(kConfiguration, 0, configuration);
}

template <typename Use>
void MatcherNodelet::use(const std::string& what, const Use& use) {
  try {
    use();
    sendConfiguration();
  } catch (const std::exception& error) {
    NODELET_ERROR("%s is refused, the old one stays: %s", what.c_str(),
                  util::printable(error.what(), 600).c_str());
  }
}

void MatcherNodelet::lensArrived(const sensor_msgs::CameraInfo& info) {
  std::string problem;
  const std::string before = settings_.configuration().lens_problem;
  if (!settings_.setLens(info, problem)) return;
  if (!problem.empty() && problem != before) {
    NODELET_WARN("%s cannot be used: %s", camera_info_->topic().c_str(), problem.c_str());
  }
  sendConfiguration();
}

void MatcherNodelet::cameraArrived(const sensor_msgs::CameraInfoConstPtr& info) {
  std::string problem;
  const std::string before = settings_.configuration().camera_problem;
  if (!settings_.setCamera(info, problem)) return;
  if (!problem.empty() && problem != before) {
    NODELET_WARN("%s cannot be used for the camera's motion: %s", camera_info_->topic().c_str(),
                 problem.c_str());
  }
  sendConfiguration();
}

// Reads the reference file again if it has changed. Called once a second, and by ~reset.
void MatcherNodelet::rereadReference(bool at_once) {
  // A reference from ~set_reference stays until ~reset, as one from ~reference does.
  if (facts_.holds_set_reference && !at_once) return;
  try {
    if (!settings_.rereadReference(at_once)) return;
    sendConfiguration();
    diagnosis_.setFault("parameters", "");
    NODELET_INFO("reference_image %s has changed and was read again",
                 settings_.referenceFile().c_str());
  } catch (const std::exception& error) {
    refuseParameters(error.what());
  }
}

// The reference that ~set_reference took from the stream is lost when the process ends. A parameter
// on the ROS master records that there was such a reference, so that the next process can report
// the loss.
void MatcherNodelet::beforeReport() {
  ros::NodeHandle node = privateNode(slow_queue_);
  const bool holds = facts_.holds_set_reference;
  if (holds && !remembers_reference_) node.setParam("reference_was_set", true);
  if (!holds && remembers_reference_) node.deleteParam("reference_was_set");
  remembers_reference_ = holds;

  const auto frames = static_cast<double>(diagnosis_.recent("frames matched"));
  const auto found = static_cast<double>(diagnosis_.recent("geometries"));
  const std::string what = facts_.finds_geometries ? "geometries" : "homographies";
  const bool is_rare = frames > 0.0 && found < kMinShare * frames;
  const std::string size = noteOnSize(facts_.longer_side);
  diagnosis_.setProblem("homographies", !is_rare ? ""
                                                 : (found == 0.0 ? "no " : "few ") + what +
                                                       " found: " + toString(facts_.last_failure) +
                                                       (size.empty() ? "" : "; " + size));
  const auto with_still_things = static_cast<double>(diagnosis_.recent(kStillThings));
  const bool are_still = !is_fixed_ && frames > 0.0 && with_still_things > kMinShare * frames;
  diagnosis_.setProblem(
      "still",
      are_still ? std::string(matching::kThingsStandStill) + "; hide them with mask_image" : "");
  diagnosis_.setState(frames == 0.0 ? "nothing to match" : what + " found");
  diagnosis_.setValue("share with geometry", std::to_string(frames > 0.0 ? found / frames : 0.0));
}

void MatcherNodelet::setReference() {
  if (!is_fixed_) throw std::runtime_error("reference_mode is not fixed; set it first");
  if (paused_) throw std::runtime_error("paused: images are ignored; call resume first");
  if (!isListening()) {
    throw std::runtime_error("idle: no image is received, since no output has a subscriber");
  }
  worker_.post([](MatcherWork& work) { work.fixNextFrame(); });
  diagnosis_.setFault("lost reference", "");
}

void MatcherNodelet::matchPair(MatchPair::Request& request, MatchPair::Response& response) {
  response.homography.status = response.statistics.status = MatchStatus::STATUS_NO_REFERENCE;
  requireSmall("reference", request.reference);
  requireSmall("target", request.target);
  Configuration configuration = worker_.ask([](MatcherWork& work) { return work.configuration(); });
  configuration.sequence.reference.mode = ReferenceMode::fixed;
  // Do not use the camera's lens and masks, since the images may be from another camera.
  configuration.view = {};
  // Wait for the simulated views of the reference. Otherwise the target, which is the only one,
  // would be matched without them.
  configuration.sequence.views_in_background = false;
  configuration.reference_image = boost::make_shared<sensor_msgs::Image>(request.reference);
  configuration.reference_frame = nullptr;
  // Prefix of the error text. Without it, the text would not say which image is wrong.
  const char* image = "reference: ";
  try {
    MessageMatcher matcher(configuration);
    image = "target: ";
    const FrameMessages messages =
        toMessages(matcher.process(boost::make_shared<sensor_msgs::Image>(request.target)));
    response.correspondences = *messages.correspondences;
    response.homography = *messages.homography;
    response.statistics = *messages.statistics;
  } catch (const std::exception& error) {
    throw std::runtime_error(std::string(image) + error.what());
  }
}

}  // namespace ktgp_orb

PLUGINLIB_EXPORT_CLASS(ktgp_orb::MatcherNodelet, nodelet::Nodelet)
