#include "matcher_nodelet.h"

#include <pluginlib/class_list_macros.hpp>

#include <algorithm>
#include <opencv2/core/utility.hpp>
#include <stdexcept>

#include "image_conversion.h"

namespace ktgp_orb {
namespace {

constexpr int kSilentSecondsBeforeWarning = 5;
constexpr double kRepeatWarning = 30.0;  // s between repetitions of a warning
constexpr double kRepeatError = 5.0;     // s between repetitions of an error per image

using Lock = std::lock_guard<std::mutex>;

double latencySeconds(const ros::Time& stamp) {
  return stamp.isZero() ? 0.0 : (ros::Time::now() - stamp).toSec();
}

MonitorLimits limitsFrom(const KtgpConfig& config) {
  return {config.min_input_rate, config.max_drop_ratio, config.max_latency, config.min_ok_ratio};
}

}  // namespace

// Handles are shut down one by one: each shutdown waits for a callback of it that is still running,
// and only then does what the callbacks use go away.
MatcherNodelet::~MatcherNodelet() {
  for (ros::ServiceServer& service : services_) service.shutdown();
  watch_timer_.stop();
  reconfigure_server_.reset();
  {
    const Lock lock(connect_mutex_);
    advertised_ = false;
    unsubscribe();
  }
  newest_.close();
  if (worker_.joinable()) worker_.join();
  correspondences_pub_.shutdown();
  homography_pub_.shutdown();
  accumulated_pub_.shutdown();
  statistics_pub_.shutdown();
  overlay_pub_.shutdown();
}

void MatcherNodelet::onInit() {
  try {
    start();
  } catch (const std::exception& error) {
    NODELET_FATAL("%s", error.what());  // what loads the nodelet may not say why it failed
    throw;
  }
}

void MatcherNodelet::start() {
  ros::NodeHandle& private_node = getPrivateNodeHandle();
  transport_hint_ = private_node.param<std::string>("image_transport", "raw");
  image_topic_ = getNodeHandle().resolveName("image");
  requireTransport();
  requireParametersInRange(private_node);
  for (const std::string& name : unknownParameters(private_node)) {
    NODELET_WARN("parameter %s is not known to this node and has no effect", name.c_str());
  }

  startReconfigure();
  matcher_ = std::make_unique<SequenceMatcher>(configuration_);
  worker_ = std::thread(&MatcherNodelet::work, this);
  diagnostics_ =
      std::make_unique<diagnostic_updater::Updater>(getNodeHandle(), private_node, getName());
  diagnostics_->setHardwareID(image_topic_);
  diagnostics_->add("input", &monitor_, &MatcherMonitor::reportInput);
  diagnostics_->add("matcher", &monitor_, &MatcherMonitor::reportMatcher);
  diagnostics_->add("latency", &monitor_, &MatcherMonitor::reportLatency);
  monitor_.setListening(false, image_topic_);
  advertise();
  advertiseServices();
  // Wall time: the watch must go on while a bag with --clock is paused.
  watch_timer_ = getNodeHandle().createWallTimer(ros::WallDuration(1.0),
                                                 [this](const ros::WallTimerEvent&) { watch(); });
  NODELET_INFO("matches images on %s (transport %s) while %s/* has subscribers",
               image_topic_.c_str(), transport_hint_.c_str(), private_node.getNamespace().c_str());
}

void MatcherNodelet::requireTransport() const {
  const image_transport::ImageTransport transport(getNodeHandle());
  const auto names = transport.getLoadableTransports();
  const std::string wanted = "image_transport/" + transport_hint_;
  if (std::find(names.begin(), names.end(), wanted) != names.end()) return;
  throw std::invalid_argument("image transport '" + transport_hint_ +
                              "' is not installed; the package " + transport_hint_ +
                              "_image_transport brings it (on ROS Noetic: apt install ros-noetic-" +
                              transport_hint_ + "-image-transport)");
}

void MatcherNodelet::advertise() {
  // Locked until all are there, so that an early subscriber does not find half of them.
  const Lock lock(connect_mutex_);
  ros::NodeHandle& node = getPrivateNodeHandle();
  const ros::SubscriberStatusCallback changed = [this](const ros::SingleSubscriberPublisher&) {
    connectionsChanged();
  };
  const image_transport::SubscriberStatusCallback overlay_changed =
      [this](const image_transport::SingleSubscriberPublisher&) { connectionsChanged(); };
  transport_ = std::make_unique<image_transport::ImageTransport>(getNodeHandle());
  private_transport_ = std::make_unique<image_transport::ImageTransport>(node);
  correspondences_pub_ = node.advertise<Correspondences>("correspondences", 1, changed, changed);
  homography_pub_ = node.advertise<HomographyStamped>("homography", 1, changed, changed);
  accumulated_pub_ =
      node.advertise<HomographyStamped>("accumulated_homography", 1, changed, changed);
  statistics_pub_ = node.advertise<MatchStatistics>("statistics", 1, changed, changed);
  overlay_pub_ =
      private_transport_->advertise("matches_image", 1, overlay_changed, overlay_changed);
  advertised_ = true;
}

template <typename Change>
ros::ServiceServer MatcherNodelet::trigger(const std::string& name, const std::string& answer,
                                           Change change) {
  using Request = std_srvs::Trigger::Request;
  using Response = std_srvs::Trigger::Response;
  const boost::function<bool(Request&, Response&)> callback = [=](Request&, Response& response) {
    change();
    response.success = true;
    response.message = answer;
    return true;
  };
  return getPrivateNodeHandle().advertiseService(name, callback);
}

void MatcherNodelet::advertiseServices() {
  services_.push_back(trigger("reset", "every reference is forgotten", [this] {
    const Lock lock(state_mutex_);
    requests_.reset = true;
  }));
  services_.push_back(
      trigger("set_reference", "the next image becomes the fixed reference", [this] {
        const Lock lock(state_mutex_);
        requests_.set_reference = true;
      }));
  services_.push_back(trigger("pause", "images are ignored until resumed", [this] {
    paused_ = true;
    newest_.clear();
  }));
  services_.push_back(trigger("resume", "images are matched again", [this] { paused_ = false; }));
  // Matching a pair takes a while: on the threads that serve several callbacks at a time.
  services_.push_back(
      getMTPrivateNodeHandle().advertiseService("match_pair", &MatcherNodelet::matchPair, this));
}

void MatcherNodelet::startReconfigure() {
  reconfigure_server_ = std::make_unique<dynamic_reconfigure::Server<KtgpConfig>>(
      reconfigure_mutex_, getPrivateNodeHandle());
  reconfigure_server_->setCallback(
      [this](KtgpConfig& config, std::uint32_t /*level*/) { reconfigured(config); });
}

void MatcherNodelet::reconfigured(KtgpConfig& config) {
  const Lock lock(state_mutex_);
  try {
    const std::uint32_t number = configured_ ? configuration_.number + 1 : 0;
    const Configuration configuration = configurationFrom(config, number);
    const KtgpMatcher checked(configuration.matcher);  // refuses NaN, which no clamp catches
    const OrbExtractor checked_extractor(configuration.orb);
    configuration_ = configuration;
    config_ = config;
    configured_ = true;
    monitor_.setLimits(limitsFrom(config));
  } catch (const std::invalid_argument& error) {
    if (!configured_) throw;
    NODELET_ERROR("new parameters are refused, the old ones stay: %s", error.what());
    config = config_;
  }
}

bool MatcherNodelet::anySubscriber() const {
  return correspondences_pub_.getNumSubscribers() > 0 || homography_pub_.getNumSubscribers() > 0 ||
         accumulated_pub_.getNumSubscribers() > 0 || statistics_pub_.getNumSubscribers() > 0 ||
         overlay_pub_.getNumSubscribers() > 0;
}

void MatcherNodelet::connectionsChanged() {
  const Lock lock(connect_mutex_);
  if (!advertised_) return;
  const bool wanted = anySubscriber();
  if (wanted && !subscribed_) subscribe();
  if (!wanted && subscribed_) unsubscribe();
}

void MatcherNodelet::subscribe() {
  const int queue_size = std::max(1, getPrivateNodeHandle().param("queue_size", 1));
  const image_transport::TransportHints hints(transport_hint_, ros::TransportHints(),
                                              getPrivateNodeHandle());
  image_sub_ = transport_->subscribe("image", static_cast<std::uint32_t>(queue_size),
                                     &MatcherNodelet::imageArrived, this, hints);
  subscribed_ = true;
  silent_seconds_ = 0;
  monitor_.setListening(true, image_topic_);
}

void MatcherNodelet::unsubscribe() {
  image_sub_.shutdown();
  subscribed_ = false;
  silent_seconds_ = 0;
  newest_.clear();
  monitor_.setListening(false, image_topic_);
  const Lock lock(state_mutex_);
  requests_.forget_reference = true;
}

void MatcherNodelet::imageArrived(const sensor_msgs::ImageConstPtr& image) {
  monitor_.imageArrived();
  if (paused_) return;
  if (newest_.put(image)) monitor_.imageDropped();
}

void MatcherNodelet::watch() {
  monitor_.tick();
  diagnostics_->force_update();
  warnWithoutInput();
}

void MatcherNodelet::warnWithoutInput() {
  const Lock lock(connect_mutex_);
  const std::uint64_t arrived = monitor_.arrived();
  const bool silent = arrived == arrived_before_;
  arrived_before_ = arrived;
  silent_seconds_ = silent ? silent_seconds_ + 1 : 0;
  if (silent_seconds_ < kSilentSecondsBeforeWarning) return;
  if (subscribed_) {
    NODELET_WARN_THROTTLE(kRepeatWarning, "no image on %s for %d s (%u publishers, transport %s)",
                          image_topic_.c_str(), silent_seconds_, image_sub_.getNumPublishers(),
                          transport_hint_.c_str());
    return;
  }
  // Not subscribed for want of subscribers, but a wrong topic name should show all the same.
  ros::master::V_TopicInfo topics;
  if (silent_seconds_ != kSilentSecondsBeforeWarning || !ros::master::getTopics(topics)) return;
  const std::string expected = image_sub_.getTopic().empty() ? image_topic_ : image_sub_.getTopic();
  const bool published = std::any_of(topics.begin(), topics.end(), [&](const auto& topic) {
    return topic.name == expected || topic.name == expected + "/" + transport_hint_;
  });
  if (published) {
    NODELET_INFO("waits for a subscriber on its outputs; %s is published", expected.c_str());
  } else {
    NODELET_WARN("nobody publishes %s: is the topic name right?", expected.c_str());
  }
}

void MatcherNodelet::work() {
  while (const auto image = newest_.take()) {
    try {
      applyRequests(*image);
      processImage(*image);
    } catch (const RefusedImage& error) {
      refuse(error.what());
    } catch (const std::exception& error) {  // out of memory and the like: the next frame may work
      refuse(std::string("frame lost: ") + error.what());
    }
  }
}

void MatcherNodelet::applyConfiguration() {
  Configuration configuration;
  {
    const Lock lock(state_mutex_);
    if (configuration_.number == matcher_->configuration().number) return;
    configuration = configuration_;
  }
  matcher_->configure(configuration);
}

void MatcherNodelet::applyRequests(const sensor_msgs::ImageConstPtr& image) {
  const std::string image_file = matcher_->configuration().reference_image;
  applyConfiguration();
  const Configuration& configuration = matcher_->configuration();
  cv::setNumThreads(configuration.threads > 0 ? configuration.threads : -1);
  Requests requests;
  {
    const Lock lock(state_mutex_);
    std::swap(requests, requests_);
  }
  if (requests.forget_reference) matcher_->forgetReference();
  if (requests.reset) matcher_->reset();
  if (requests.set_reference) matcher_->setFixedReference(image);
  if (configuration.reference_image != image_file && !configuration.reference_image.empty()) {
    matcher_->setFixedReference(readImageFile(configuration.reference_image));
  }
}

void MatcherNodelet::processImage(const sensor_msgs::ImageConstPtr& image) {
  const bool overlay = matcher_->configuration().overlay && overlay_pub_.getNumSubscribers() > 0;
  FrameMessages messages = matcher_->process(image, overlay);
  MatchStatistics& statistics = *messages.statistics;
  const double latency = latencySeconds(statistics.header.stamp);
  statistics.latency_milliseconds = 1e3 * latency;
  statistics.dropped_frames = monitor_.dropped();
  statistics.refused_frames = monitor_.refused();
  const std::size_t inliers = messages.homography ? messages.homography->inliers : 0;
  monitor_.frameMatched(static_cast<Status>(statistics.status), inliers, latency);
  publish(messages);
}

void MatcherNodelet::publish(const FrameMessages& messages) {
  if (messages.correspondences) correspondences_pub_.publish(messages.correspondences);
  if (messages.homography) homography_pub_.publish(messages.homography);
  if (messages.accumulated_homography) accumulated_pub_.publish(messages.accumulated_homography);
  if (messages.overlay) overlay_pub_.publish(messages.overlay);
  statistics_pub_.publish(messages.statistics);  // last: whoever has it has the others
}

void MatcherNodelet::refuse(const std::string& reason) {
  monitor_.imageRefused(reason);
  NODELET_ERROR_THROTTLE(kRepeatError, "image on %s is refused: %s", image_topic_.c_str(),
                         reason.c_str());
}

bool MatcherNodelet::matchPair(MatchPair::Request& request, MatchPair::Response& response) {
  Configuration configuration;
  {
    const Lock lock(state_mutex_);
    configuration = configuration_;
  }
  configuration.reference.mode = ReferenceMode::fixed;
  try {
    SequenceMatcher matcher(configuration);
    matcher.setFixedReference(boost::make_shared<sensor_msgs::Image>(request.reference));
    const FrameMessages messages =
        matcher.process(boost::make_shared<sensor_msgs::Image>(request.target), false);
    response.correspondences = *messages.correspondences;
    response.homography = *messages.homography;
    response.statistics = *messages.statistics;
    response.success = true;
  } catch (const std::exception& error) {
    response.success = false;
    response.message = error.what();
  }
  return true;
}

}  // namespace ktgp_orb

PLUGINLIB_EXPORT_CLASS(ktgp_orb::MatcherNodelet, nodelet::Nodelet)
