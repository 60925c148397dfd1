#include <ktgp_orb/MatchStatus.h>
#include <ktgp_orb/MosaicConfig.h>
#include <ktgp_orb/SaveMosaic.h>
#include <std_srvs/Trigger.h>
#include <pluginlib/class_list_macros.hpp>

#include <boost/make_shared.hpp>
#include <chrono>
#include <cstdio>
#include <deque>
#include <limits>
#include <opencv2/imgcodecs.hpp>
#include <vector>

#include "files/output_file.h"
#include "ktgp_orb/mosaic.h"
#include "messages/colour_image.h"
#include "nodelet/frame_consumer.h"

namespace ktgp_orb {
namespace {

using Clock = std::chrono::steady_clock;
using Lock = std::lock_guard<std::mutex>;
using std_srvs::Trigger;

MosaicOptions optionsFrom(const MosaicConfig& config) {
  MosaicOptions options;
  options.max_megapixels = config.max_megapixels;
  options.keyframes = config.keyframes;
  options.keyframe_overlap = config.keyframe_overlap;
  options.min_motion = config.min_motion;
  options.gain = config.gain;
  options.patience = config.patience;
  options.orb.max_features = config.features;
  return options;
}

std::string withOneDigit(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%.1f", value);
  return text;
}

}  // namespace

/// Images and homographies in, a growing mosaic out. doc/views.md describes topics, services and
/// parameters.
class MosaicNodelet : public FrameConsumer {
 public:
  ~MosaicNodelet() override {
    service_queue_.stop();
    stop();
    shutdown();
  }

 private:
  void configure() override;
  void advertise() override;
  bool isWanted() const override { return !lazy_ || outputs_.haveSubscribers(); }
  void shutdown() override;
  void work(FrameInbox::Content& content) override;
  void restart() override { images_.clear(); }
  std::string whyEmpty();
  void place(const HomographyStamped& message, const sensor_msgs::ImageConstPtr& image);
  void publishPose(const HomographyStamped& message);
  void publishPicture(const std_msgs::Header& header);
  void reportMap();
  bool save(SaveMosaic::Request& request, SaveMosaic::Response& response);
  bool reset(Trigger::Request& request, Trigger::Response& response);

  CallbackThread service_queue_;  // saving takes a while
  image_transport::Publisher mosaic_pub_;
  ros::Publisher homography_pub_;
  std::vector<ros::ServiceServer> services_;
  std::unique_ptr<dynamic_reconfigure::Server<MosaicConfig>> server_;
  std::atomic<bool> lazy_{false};
  std::atomic<bool> picture_wanted_{false};  // by a new subscriber
  std::atomic<bool> reset_{false};

  std::mutex config_mutex_;  // guards config_
  MosaicConfig config_;
  bool config_changed_ = true;

  std::mutex map_mutex_;  // held by the worker to change mosaic_, and by others to read it
  Mosaic mosaic_;

  // Used only by the worker
  MosaicConfig current_;
  std_msgs::Header last_header_;                    // of the last placed image
  std::deque<HomographyStampedConstPtr> unplaced_;  // whose image may still arrive
  Clock::time_point last_picture_;
  bool said_full_ = false;
};

void MosaicNodelet::configure() {
  server_ = serveParameters<MosaicConfig>([this](const MosaicConfig& config) {
    {
      const Lock lock(config_mutex_);
      config_ = config;
      config_changed_ = true;
    }
    lazy_ = config.lazy;
    connectionsChanged();
  });
}

void MosaicNodelet::advertise() {
  mosaic_pub_ = outputs_.advertiseImage("mosaic", 1, true, [this] {
    picture_wanted_ = true;
    wake();
  });
  homography_pub_ = outputs_.advertise<HomographyStamped>("homography", 10);
  ros::NodeHandle service_node = privateNode(service_queue_);
  services_.push_back(service_node.advertiseService("save", &MosaicNodelet::save, this));
  services_.push_back(service_node.advertiseService("reset", &MosaicNodelet::reset, this));
  service_queue_.start();
}

void MosaicNodelet::shutdown() {
  server_.reset();
  services_.clear();
}

// All homographies are links of the chain; only the newest image with a homography is placed.
void MosaicNodelet::work(FrameInbox::Content& content) {
  bool changed = false;
  {
    const Lock lock(config_mutex_);
    current_ = config_;
    changed = std::exchange(config_changed_, false);
  }
  for (const auto& image : content.images) keep(image);
  content.images.clear();
  {
    const Lock lock(map_mutex_);
    if (changed) mosaic_.setOptions(optionsFrom(current_));
    if (reset_.exchange(false)) mosaic_.reset();
    for (const auto& h : content.homographies) {
      mosaic_.follow(stampOf(h->header.stamp), stampOf(h->reference_stamp), homographyOf(*h));
    }
  }
  for (const auto& h : content.homographies) unplaced_.push_back(h);
  while (unplaced_.size() > kImages) unplaced_.pop_front();
  for (std::size_t i = unplaced_.size(); i-- > 0;) {
    const HomographyStampedConstPtr message = unplaced_[i];
    const auto image = images_.take(message->header.stamp);
    if (!image) continue;
    const auto end = unplaced_.begin() + static_cast<std::ptrdiff_t>(i) + 1;
    unplaced_.erase(unplaced_.begin(), end);
    monitor_.dropped(i);
    place(*message, image);
    break;
  }
  if (picture_wanted_.exchange(false)) publishPicture(last_header_);
}

void MosaicNodelet::place(const HomographyStamped& message,
                          const sensor_msgs::ImageConstPtr& image) {
  const cv::Mat colour = colourImage(image);
  const auto start = Clock::now();
  {
    const Lock lock(map_mutex_);
    const Placement placement = mosaic_.place(stampOf(message.header.stamp), colour);
    monitor_.setValue("last frame", toString(placement));
  }
  monitor_.done(std::chrono::duration<double, std::milli>(Clock::now() - start).count());
  last_header_ = message.header;
  reportMap();
  if (homography_pub_.getNumSubscribers() > 0) publishPose(message);
  const auto period = std::chrono::duration<double>(1.0 / current_.rate);
  if (mosaic_pub_.getNumSubscribers() > 0 && Clock::now() - last_picture_ >= period) {
    last_picture_ = Clock::now();
    publishPicture(message.header);
  }
}

// Only the worker changes the mosaic, so it may read it without the lock.
void MosaicNodelet::reportMap() {
  monitor_.setValue("megapixels", withOneDigit(mosaic_.megapixels()));
  monitor_.setValue("keyframes", std::to_string(mosaic_.keyframes()));
  monitor_.setValue("maps begun", std::to_string(mosaic_.maps()));
  const bool full = mosaic_.full();
  monitor_.setWarning(full ? "the mosaic is full (max_megapixels): it does not grow any more" : "");
  if (full && !said_full_) {
    NODELET_WARN("the mosaic has reached max_megapixels (%.1f) and does not grow any more",
                 current_.max_megapixels);
  }
  said_full_ = full;
}

void MosaicNodelet::publishPose(const HomographyStamped& message) {
  auto pose = boost::make_shared<HomographyStamped>();
  pose->header = message.header;
  pose->rectified = message.rectified;
  pose->reference_stamp = timeOf(mosaic_.firstStamp());
  pose->status = MatchStatus::STATUS_NO_MODEL;
  if (const auto h = mosaic_.pose()) {
    pose->status = MatchStatus::STATUS_OK;
    Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(pose->homography.data()) = *h;
    pose->covariance.fill(std::numeric_limits<double>::quiet_NaN());
  }
  homography_pub_.publish(pose);
}

void MosaicNodelet::publishPicture(const std_msgs::Header& header) {
  const cv::Mat picture = mosaic_.picture(current_.picture_size);
  if (picture.empty()) return;
  auto message = boost::make_shared<sensor_msgs::Image>();
  message->header = header;
  message->encoding = "bgr8";
  message->width = static_cast<std::uint32_t>(picture.cols);
  message->height = static_cast<std::uint32_t>(picture.rows);
  message->step = static_cast<std::uint32_t>(picture.cols * picture.elemSize());
  message->data.assign(picture.datastart, picture.dataend);
  mosaic_pub_.publish(message);
}

bool MosaicNodelet::save(SaveMosaic::Request& request, SaveMosaic::Response& response) {
  response.success = false;
  const std::string& file = request.file;
  if (file.empty() || file[0] != '/' || file.size() < 5 || file.substr(file.size() - 4) != ".png") {
    response.message = "file is '" + file + "'; expected an absolute path that ends in .png";
    return true;
  }
  cv::Mat picture;
  {
    const Lock lock(map_mutex_);
    picture = mosaic_.image();
  }
  if (picture.empty()) {
    response.message = "there is no mosaic yet: " + whyEmpty();
    return true;
  }
  try {
    files::writeImage(file, picture, true);
    response.success = true;
    response.message = file;
    response.width = static_cast<std::uint32_t>(picture.cols);
    response.height = static_cast<std::uint32_t>(picture.rows);
  } catch (const std::exception& error) {  // cv::Exception too
    response.message = error.what();
  }
  return true;
}

std::string MosaicNodelet::whyEmpty() {
  if (!isSubscribed()) return "lazy is on, and no output has a subscriber: no image is received";
  if (monitor_.images() == 0) return "no image has arrived on " + image_topic_;
  if (monitor_.homographies() == 0) {
    return "no homography has arrived on " + homography_topic_ + ": is the matcher running?";
  }
  return "of " + std::to_string(monitor_.images()) + " images, none was placed; " +
         std::to_string(monitor_.found()) + " of " + std::to_string(monitor_.homographies()) +
         " homographies were found";
}

bool MosaicNodelet::reset(Trigger::Request& /*request*/, Trigger::Response& response) {
  reset_ = true;
  wake();
  response.success = true;
  response.message = "the next frame begins a new map";
  return true;
}

}  // namespace ktgp_orb

PLUGINLIB_EXPORT_CLASS(ktgp_orb::MosaicNodelet, nodelet::Nodelet)
