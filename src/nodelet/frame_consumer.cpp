#include "nodelet/frame_consumer.h"

#include <ktgp_orb/MatchStatus.h>

#include <utility>

#include "messages/image_conversion.h"

namespace ktgp_orb {
namespace {

using Lock = std::lock_guard<std::mutex>;

constexpr std::uint32_t kHomographies = 100;  // each is a link of the chain, so none should be lost

}  // namespace

FrameConsumer::~FrameConsumer() = default;

// Callbacks must end before anything else.
void FrameConsumer::stop() {
  for (CallbackThread* queue : {&queue_, &data_queue_, &slow_queue_}) queue->stop();
  inbox_.close();
  if (worker_.joinable()) worker_.join();
  timer_.stop();
  disconnect();
  outputs_.shutdown();
  diagnostics_.reset();
}

void FrameConsumer::start() {
  node_ = getNodeHandle();
  node_.setCallbackQueue(&queue_.callbacks);
  data_node_ = getNodeHandle();
  data_node_.setCallbackQueue(&data_queue_.callbacks);
  private_node_ = privateNode(queue_);
  openInput(node_, private_node_, 5);
  homography_topic_ = node_.resolveName("homography");
  homography_watch_ = std::make_unique<InputWatch>(InputWatch::ofMessages(
      homography_topic_, ros::message_traits::datatype<HomographyStamped>(), "homography"));
  monitor_.setTopics(image_topic_, homography_topic_);
  transport_ = std::make_unique<image_transport::ImageTransport>(data_node_);
  outputs_.open(private_node_, [this] { connectionsChanged(); });
  configure();
  worker_ = std::thread(&FrameConsumer::run, this);
  diagnostics_ = std::make_unique<diagnostic_updater::Updater>(node_, private_node_, getName());
  diagnostics_->setHardwareID(image_topic_);
  diagnostics_->add("frames", &monitor_, &ConsumerMonitor::report);
  connect([this] { advertise(); });
  ros::NodeHandle slow_node = getNodeHandle();
  slow_node.setCallbackQueue(&slow_queue_.callbacks);
  timer_ = slow_node.createWallTimer(ros::WallDuration(1.0),
                                     [this](const ros::WallTimerEvent&) { tick(); });
  for (CallbackThread* queue : {&queue_, &data_queue_, &slow_queue_}) queue->start();
  connectionsChanged();
  NODELET_INFO("takes images on %s (transport %s) and homographies on %s", image_topic_.c_str(),
               transport_hints_->getTransport().c_str(), homography_topic_.c_str());
}

ros::NodeHandle FrameConsumer::privateNode(CallbackThread& queue) const {
  ros::NodeHandle node = getPrivateNodeHandle();
  node.setCallbackQueue(&queue.callbacks);
  return node;
}

void FrameConsumer::subscribe() {
  // If publisher and subscriber of one process start at the same time, ROS may connect them twice
  // and deliver everything twice.
  image_sub_ = transport_->subscribe(
      image_topic_, queue_size_,
      [this](const sensor_msgs::ImageConstPtr& image) {
        if (last_image_.lock() == image) return;
        last_image_ = image;
        monitor_.imageArrived();
        monitor_.dropped(inbox_.put(image));
      },
      ros::VoidPtr(), *transport_hints_);
  homography_sub_ = data_node_.subscribe<HomographyStamped>(
      "homography", kHomographies,
      [this](const HomographyStampedConstPtr& message) {
        if (last_homography_.lock() == message) return;
        last_homography_ = message;
        if (message->rectified && !std::exchange(said_rectified_, true)) {
          NODELET_WARN(
              "the homographies on %s are of rectified images: they fit %s only if its "
              "images are rectified, too",
              homography_topic_.c_str(), image_topic_.c_str());
        }
        monitor_.homographyArrived(message->status == MatchStatus::STATUS_OK);
        inbox_.put(message);
      },
      ros::VoidConstPtr(), ros::TransportHints().tcpNoDelay());
  monitor_.setListening(true);
}

void FrameConsumer::unsubscribe() {
  image_sub_.shutdown();
  homography_sub_.shutdown();
  inbox_.clear();
  restart_ = true;
  monitor_.setListening(false);
}

void FrameConsumer::tick() {
  std::uint32_t images = 0;
  std::uint32_t homographies = 0;
  bool subscribed = false;
  {
    const Lock lock(connect_mutex_);
    subscribed = subscribed_;
    if (subscribed) images = image_sub_.getNumPublishers();
    if (subscribed) homographies = homography_sub_.getNumPublishers();
  }
  monitor_.tick(clockStands());
  watch(*image_watch_, subscribed, monitor_.images(), images);
  watch(*homography_watch_, subscribed, monitor_.homographies(), homographies);
  monitor_.setTroubles(image_watch_->trouble(), homography_watch_->trouble());
  monitor_.setMixture(watchMixture(images));
  diagnostics_->force_update();
}

// A quarter is for the inbox, the rest for images that wait for their homography.
void FrameConsumer::setMaxMemory(int megabytes) {
  const std::size_t bytes = static_cast<std::size_t>(megabytes) * 1000 * 1000;
  inbox_.setMostBytes(bytes / 4);
  store_bytes_ = bytes - bytes / 4;
}

void FrameConsumer::sayParametersRefused(const std::string& reason) {
  monitor_.setParameterError(reason);
  NODELET_ERROR("new parameters are refused, the old ones stay: %s", reason.c_str());
}

void FrameConsumer::keep(const sensor_msgs::ImageConstPtr& image) {
  images_.setMostBytes(store_bytes_);
  monitor_.forgotten(images_.put(image));
}

void FrameConsumer::run() {
  while (auto content = inbox_.take()) {
    try {
      if (restart_.exchange(false)) restart();
      work(*content);
    } catch (const RefusedImage& error) {
      refuse(error.what());
    } catch (const std::exception& error) {  // out of memory, for example: the next frame may work
      refuse(std::string("frame lost: ") + error.what());
    }
  }
}

void FrameConsumer::refuse(const std::string& reason) {
  monitor_.refused(reason);
  sayRefused(reason);
}

std::int64_t stampOf(const ros::Time& time) {
  return static_cast<std::int64_t>(time.toNSec());
}

ros::Time timeOf(std::int64_t nanoseconds) {
  ros::Time time;
  time.fromNSec(static_cast<std::uint64_t>(nanoseconds));
  return time;
}

std::optional<Eigen::Matrix3d> homographyOf(const HomographyStamped& message) {
  if (message.status != MatchStatus::STATUS_OK) return std::nullopt;
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(message.homography.data());
}

}  // namespace ktgp_orb
