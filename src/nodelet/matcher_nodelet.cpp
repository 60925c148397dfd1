#include "nodelet/matcher_nodelet.h"

#include <pluginlib/class_list_macros.hpp>

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "messages/camera.h"
#include "messages/image_conversion.h"
#include "nodelet/parameters.h"

namespace ktgp_orb {
namespace {

constexpr std::uint32_t kDataQueue = 10;  // messages queued for a slow subscriber

// Drawn at least this often, even if newer images always wait.
constexpr std::chrono::seconds kLongestWithoutOverlay{1};

/// `later` - `earlier`, s. Accepts the stamps of any camera; ros::Duration throws beyond 68 years.
double secondsBetween(const ros::Time& earlier, const ros::Time& later) {
  const double seconds = static_cast<double>(later.sec) - static_cast<double>(earlier.sec);
  return seconds + 1e-9 * (static_cast<double>(later.nsec) - static_cast<double>(earlier.nsec));
}

using Lock = std::lock_guard<std::mutex>;

double latencySeconds(const ros::Time& stamp) {
  const ros::Time now = ros::Time::now();
  // A simulated clock that never started gives no latency.
  return stamp.isZero() || now.isZero() ? 0.0 : secondsBetween(stamp, now);
}

MonitorLimits limitsFrom(const KtgpConfig& config) {
  return {config.min_input_rate, config.max_drop_ratio, config.max_lost_ratio,
          config.max_latency,    config.min_ok_ratio,   config.error_factor};
}

}  // namespace

MatcherNodelet::~MatcherNodelet() {
  stop();
}

// Callbacks must end before anything else: destroying a dynamic_reconfigure server during a
// callback crashes the manager.
void MatcherNodelet::stop() {
  for (CallbackThread* queue :
       {&queue_, &image_queue_, &service_queue_, &slow_queue_, &pair_queue_}) {
    queue->stop();
  }
  newest_.close();
  if (worker_.joinable()) worker_.join();
  for (ros::ServiceServer& service : services_) service.shutdown();
  for (ros::WallTimer* timer : {&watch_timer_, &report_timer_, &file_timer_, &reset_timer_}) {
    timer->stop();
  }
  mask_sub_.shutdown();
  reference_sub_.shutdown();
  reconfigure_server_.reset();
  disconnect();
  outputs_.shutdown();
  diagnostics_.reset();
}

void MatcherNodelet::start() {
  node_ = getNodeHandle();
  node_.setCallbackQueue(&queue_.callbacks);
  image_node_ = getNodeHandle();
  image_node_.setCallbackQueue(&image_queue_.callbacks);
  private_node_ = getPrivateNodeHandle();
  private_node_.setCallbackQueue(&queue_.callbacks);
  openInput(node_, private_node_, 1);
  checkParameters<KtgpConfig>(private_node_);
  requireMode(private_node_);
  completeRatioThreshold(private_node_);
  monitor_.setTopic(image_topic_);
  startReconfigure();
  if (private_node_.deleteParam("reference_was_set") && config_.reference_mode == "fixed") {
    reference_lost_ = true;
    NODELET_WARN("%s", kReferenceLost);
  }
  matcher_ = std::make_unique<MessageMatcher>(configuration_);
  worker_ = std::thread(&MatcherNodelet::work, this);
  diagnostics_ = std::make_unique<diagnostic_updater::Updater>(node_, private_node_, getName());
  diagnostics_->setHardwareID(image_topic_);
  diagnostics_->add("input", &monitor_, &MatcherMonitor::reportInput);
  diagnostics_->add("matcher", &monitor_, &MatcherMonitor::reportMatcher);
  diagnostics_->add("latency", &monitor_, &MatcherMonitor::reportLatency);
  connect([this] { advertise(); });
  advertiseServices();
  subscribeSideInputs();
  startTimers();
  for (CallbackThread* queue :
       {&queue_, &image_queue_, &service_queue_, &slow_queue_, &pair_queue_}) {
    queue->start();
  }
  connectionsChanged();  // also without a subscriber, if lazy is off
  NODELET_INFO(
      "matches images on %s (transport %s)%s", image_topic_.c_str(),
      transport_hints_->getTransport().c_str(),
      lazy_ ? (" while " + private_node_.getNamespace() + "/* has subscribers").c_str() : "");
}

// Wall time: these must continue while a bag with --clock is paused.
void MatcherNodelet::startTimers() {
  ros::NodeHandle slow_node = getNodeHandle();
  slow_node.setCallbackQueue(&slow_queue_.callbacks);
  watch_timer_ = slow_node.createWallTimer(ros::WallDuration(1.0),
                                           [this](const ros::WallTimerEvent&) { watchInput(); });
  report_timer_ = slow_node.createWallTimer(ros::WallDuration(1.0),
                                            [this](const ros::WallTimerEvent&) { report(); });
  // In the queue of the parameters, which may read files, too.
  file_timer_ = node_.createWallTimer(
      ros::WallDuration(1.0), [this](const ros::WallTimerEvent&) { rereadReference(false); });
  reset_timer_ = node_.createWallTimer(
      ros::WallDuration(0.001), [this](const ros::WallTimerEvent&) { rereadReference(true); }, true,
      false);
}

/// A topic with one message per frame, which `pick` selects; if it returns null, nothing is
/// published.
template <typename Message, typename Pick>
void MatcherNodelet::advertiseOfFrames(const std::string& topic, const Pick& pick) {
  const ros::Publisher publisher = outputs_.advertise<Message>(topic, kDataQueue);
  frame_outputs_.emplace_back([publisher, pick](const FrameMessages& messages) {
    if (publisher.getNumSubscribers() == 0) return;
    if (const boost::shared_ptr<const Message> message = pick(messages)) publisher.publish(message);
  });
}

void MatcherNodelet::advertise() {
  using Frame = FrameMessages;
  transport_ = std::make_unique<image_transport::ImageTransport>(image_node_);
  outputs_.open(private_node_, [this] { connectionsChanged(); });
  advertiseOfFrames<Correspondences>("correspondences",
                                     [](const Frame& frame) { return frame.correspondences; });
  advertiseOfFrames<HomographyStamped>("homography",
                                       [](const Frame& frame) { return frame.homography; });
  advertiseOfFrames<HomographyStamped>(
      "accumulated_homography", [](const Frame& frame) { return frame.accumulated_homography; });
  advertiseOfFrames<Match>("match", [](const Frame& frame) { return toMatch(frame); });
  // The last one: it marks that all others were sent.
  advertiseOfFrames<MatchStatistics>("statistics",
                                     [](const Frame& frame) { return frame.statistics; });
  // A slow subscriber should not lose data; of the pictures it needs only the newest.
  overlay_pub_ = outputs_.advertiseImage("matches_image", 1);
}

void MatcherNodelet::startReconfigure() {
  reconfigure_server_ =
      std::make_unique<dynamic_reconfigure::Server<KtgpConfig>>(reconfigure_mutex_, private_node_);
  reconfigure_server_->setCallback(
      [this](KtgpConfig& config, std::uint32_t /*level*/) { reconfigured(config); });
  if (!configured_) {
    throw std::invalid_argument(
        "the parameters of " + private_node_.getNamespace() + " cannot be used: " + refusal_ +
        ". Set others, or remove them with 'rosparam delete " + private_node_.getNamespace() + "'");
  }
}

void MatcherNodelet::reconfigured(KtgpConfig& config) {
  try {
    const bool described_anew = !configured_ || config.descriptor != config_.descriptor;
    if (configured_ && config.T_w == config_.T_w) {
      config.T_w = followDescriptor(config.T_w, config_.descriptor, config.descriptor);
    }
    requireFinite(config);
    configureFrom(config);
    const std::string note = noteOnRatioThreshold(config.T_w, config.descriptor);
    if (described_anew && !note.empty()) NODELET_WARN("%s", note.c_str());
    const bool is_fixed_anew = !configured_ || config.reference_mode != config_.reference_mode;
    const std::string on_fixed = noteOnFixed(parametersFrom(config));
    if (is_fixed_anew && !on_fixed.empty()) NODELET_INFO("%s", on_fixed.c_str());
    config_ = config;
    configured_ = true;
    monitor_.setParameterError("");
  } catch (const std::exception& error) {  // NaN, which is not clamped; an unknown mode or file
    if (!configured_) {
      refusal_ = error.what();  // the caller would ignore an exception
      return;
    }
    monitor_.setParameterError(error.what());
    NODELET_ERROR("new parameters are refused, the old ones stay: %s", error.what());
    config = config_;
  }
}

void MatcherNodelet::configureFrom(const KtgpConfig& config) {
  Configuration wanted = configurationFrom(config, 0);
  const bool are_rectified = pixelsFrom(config.calibration, image_topic_) == Pixels::rectified;
  if (config.rectify && are_rectified) {
    throw std::invalid_argument("rectify is on, but the images on " + image_topic_ +
                                " are rectified already (see the parameter calibration)");
  }
  // The reference stays unless it changed: the file's content, or a reference from ~reference.
  const bool same_image = configured_ && config.reference_image == config_.reference_image;
  const FileState state = same_image ? file_state_ : FileState::of(config.reference_image);
  const auto file =
      same_image ? file_reference_ : readImageFile("reference_image", config.reference_image);
  wanted.reference_image = same_image ? configuration_.reference_image : file;
  const bool same_mask = configured_ && config.mask_image == config_.mask_image;
  wanted.view.file_mask =
      same_mask ? configuration_.view.file_mask : readMaskFile(config.mask_image);
  wanted.view.sent_mask = configuration_.view.sent_mask;
  wanted.view.lens = config.rectify ? lens_ : nullptr;
  wanted.lens_problem = configuration_.lens_problem;
  file_reference_ = file;  // nothing throws after this
  file_state_ = file_seen_ = state;
  monitor_.setLimits(limitsFrom(config));
  max_rate_ = config.max_rate;
  lazy_ = config.lazy;
  change([&](Configuration& configuration) {
    wanted.number = configured_ ? configuration.number : 0;
    configuration = wanted;
  });
  {
    const Lock lock(connect_mutex_);
    subscribeCameraInfo();
  }
  connectionsChanged();  // lazy may have changed
}

// Only this function writes configuration_, in the first queue: callbacks of this queue may read it
// without a lock.
void MatcherNodelet::change(const std::function<void(Configuration&)>& edit) {
  Configuration configuration = configuration_;
  edit(configuration);
  if (configured_) ++configuration.number;
  const Lock lock(state_mutex_);
  configuration_ = configuration;
}

bool MatcherNodelet::isWanted() const {
  return !lazy_ || outputs_.haveSubscribers();
}

void MatcherNodelet::work() {
  while (const auto arrival = newest_.take()) {
    try {
      applyRequests(arrival->number);
      processImage(arrival->image);
      publishOverlay();
    } catch (const RefusedImage& error) {
      refuse(error.what());
    } catch (const std::exception& error) {  // out of memory, for example: the next frame may work
      refuse(std::string("frame lost: ") + error.what());
    }
  }
}

void MatcherNodelet::applyRequests(std::uint64_t arrival) {
  std::optional<Configuration> configuration;
  Requests requests;
  {
    const Lock lock(state_mutex_);
    if (configuration_.number != matcher_->configuration().number) configuration = configuration_;
    std::swap(requests, requests_);
    // An image from before the call does not count.
    if (requests.fix_reference_after && arrival <= *requests.fix_reference_after) {
      std::swap(requests.fix_reference_after, requests_.fix_reference_after);
    }
  }
  if (configuration) matcher_->configure(*configuration);
  if (requests.forget_reference) matcher_->forgetReference();
  if (requests.reset) matcher_->reset();
  if (requests.fix_reference_after) {
    matcher_->fixNextFrame();
    reference_lost_ = false;
  }
}

void MatcherNodelet::processImage(const sensor_msgs::ImageConstPtr& image) {
  FrameMessages messages = matcher_->process(image);
  holds_set_reference_ = matcher_->holdsSetReference();
  MatchStatistics& statistics = *messages.statistics;
  const double latency = latencySeconds(statistics.header.stamp);
  statistics.latency_milliseconds = 1e3 * latency;
  statistics.dropped_frames = monitor_.dropped();
  statistics.lost_frames = monitor_.lost();
  statistics.skipped_frames = monitor_.skipped();
  statistics.refused_frames = monitor_.refused();
  monitor_.frameMatched(static_cast<Status>(statistics.status),
                        static_cast<NoReference>(statistics.reason), messages.homography->inliers,
                        latency);
  publish(messages);
  warnOfRawPoints(messages);
}

void MatcherNodelet::warnOfRawPoints(const FrameMessages& messages) {
  const bool raw = matcher_->configuration().rectify && !messages.homography->rectified;
  if (!raw) {
    said_raw_points_.clear();
    monitor_.setLensProblem("");
    return;
  }
  const std::string reason = whyNoLens();
  const std::string problem =
      "rectify is on, but points are in raw pixels: no camera_info of a "
      "calibrated camera and of this image size on " +
      camera_info_topic_ + (reason.empty() ? "" : " (" + reason + ")");
  monitor_.setLensProblem(problem);
  if (problem != said_raw_points_) NODELET_WARN("%s", problem.c_str());
  said_raw_points_ = problem;
}

std::string MatcherNodelet::whyNoLens() const {
  const Configuration& configuration = matcher_->configuration();
  if (!configuration.view.lens) return configuration.lens_problem;
  const cv::Size size = configuration.view.lens->calibration().image_size;
  return "it is of " + std::to_string(size.width) + "x" + std::to_string(size.height) + " images";
}

void MatcherNodelet::publish(const FrameMessages& messages) {
  for (const auto& publish : frame_outputs_) publish(messages);
}

// After the data, which must not wait for the picture.
void MatcherNodelet::publishOverlay() {
  if (!matcher_->configuration().overlay || overlay_pub_.getNumSubscribers() == 0) return;
  const auto start = std::chrono::steady_clock::now();
  if (newest_.waiting() && start - last_overlay_ < kLongestWithoutOverlay) {
    monitor_.overlaySkipped();
    return;
  }
  last_overlay_ = start;
  overlay_pub_.publish(matcher_->overlay());
  monitor_.overlayDrawn(
      std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count());
}

void MatcherNodelet::refuse(const std::string& reason) {
  monitor_.imageRefused(reason);
  sayRefused(reason);
}

}  // namespace ktgp_orb

PLUGINLIB_EXPORT_CLASS(ktgp_orb::MatcherNodelet, nodelet::Nodelet)
