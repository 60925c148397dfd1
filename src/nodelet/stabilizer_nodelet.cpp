#include <ktgp_orb/StabilizerConfig.h>
#include <pluginlib/class_list_macros.hpp>

#include <Eigen/Core>
#include <boost/make_shared.hpp>
#include <chrono>
#include <deque>
#include <opencv2/core/eigen.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "ktgp_orb/stabilizer.h"
#include "messages/colour_image.h"
#include "messages/image_conversion.h"
#include "nodelet/frame_consumer.h"

namespace ktgp_orb {
namespace {

using Lock = std::lock_guard<std::mutex>;

constexpr std::size_t kImages = 40;  // that wait for their homography: a second or more

StabilizerOptions optionsFrom(const StabilizerConfig& config) {
  StabilizerOptions options;
  options.strength = config.strength;
  options.lag = config.lag;
  options.max_crop = config.max_crop;
  return options;
}

/// The frame through the warp, with the header of the frame.
sensor_msgs::ImagePtr warped(const sensor_msgs::ImageConstPtr& image, const Eigen::Matrix3d& warp) {
  const ViewedImage frame = warpableImage(image);
  auto steady = boost::make_shared<sensor_msgs::Image>();
  steady->header = image->header;
  steady->encoding = frame.encoding;
  steady->is_bigendian = image->is_bigendian;
  steady->width = image->width;
  steady->height = image->height;
  steady->step = static_cast<std::uint32_t>(frame.image.cols * frame.image.elemSize());
  steady->data.resize(std::size_t{steady->step} * steady->height);
  cv::Mat pixels(frame.image.size(), frame.image.type(), steady->data.data(), steady->step);
  cv::Mat homography;
  cv::eigen2cv(warp, homography);
  cv::warpPerspective(frame.image, pixels, homography, pixels.size(), cv::INTER_LINEAR,
                      cv::BORDER_REPLICATE);
  return steady;
}

}  // namespace

/// Images and homographies in, a steady image out. Topics and parameters stand in doc/topics.md.
class StabilizerNodelet : public FrameConsumer {
 public:
  ~StabilizerNodelet() override {
    stop();
    shutdown();
  }

 private:
  void configure() override;
  void advertise() override;
  bool isWanted() const override {
    return image_pub_.getNumSubscribers() > 0 || info_pub_.getNumSubscribers() > 0;
  }
  bool needsCameraInfo() const override { return true; }
  void shutdown() override;
  void work(FrameInbox::Content& content) override;
  void restart() override;
  void take(const sensor_msgs::CameraInfoConstPtr& info);
  void follow(const HomographyStamped& message);
  void publishDue();
  void publish(const SteadyFrame& frame, const sensor_msgs::ImageConstPtr& image);

  image_transport::Publisher image_pub_;
  ros::Publisher info_pub_;
  std::unique_ptr<dynamic_reconfigure::Server<StabilizerConfig>> server_;

  std::mutex mutex_;  // guards options_
  StabilizerOptions options_;

  // The worker's own
  Stabilizer stabilizer_;
  cv::Size size_;     // of the newest image
  ros::Time newest_;  // its stamp
  std::uint64_t restarts_ = 0;
  ByStamp<sensor_msgs::ImageConstPtr> images_{kImages};
  ByStamp<sensor_msgs::CameraInfoConstPtr> infos_{kImages};
  ByStamp<bool> without_info_{kImages};  // frames that went out before their camera_info came
  std::vector<SteadyFrame> ready_;
  std::deque<SteadyFrame> due_;  // whose image may still come
};

void StabilizerNodelet::configure() {
  server_ = serveParameters<StabilizerConfig>([this](const StabilizerConfig& config) {
    const Lock lock(mutex_);
    options_ = optionsFrom(config);
  });
}

void StabilizerNodelet::advertise() {
  image_pub_ = advertiseImage("image", 2);
  info_pub_ = advertiseData<sensor_msgs::CameraInfo>("camera_info", 2);
}

void StabilizerNodelet::shutdown() {
  server_.reset();
  image_pub_.shutdown();
  info_pub_.shutdown();
}

void StabilizerNodelet::restart() {
  stabilizer_.reset();
  images_.clear();
  infos_.clear();
  without_info_.clear();
  due_.clear();
  size_ = {};
}

void StabilizerNodelet::work(FrameInbox::Content& content) {
  {
    const Lock lock(mutex_);
    stabilizer_.setOptions(options_);
    images_.setMost(kImages + static_cast<std::size_t>(options_.lag));
    infos_.setMost(kImages + static_cast<std::size_t>(options_.lag));
  }
  for (const auto& info : content.infos) take(info);
  for (const auto& image : content.images) {
    images_.put(image->header.stamp, image);
    newest_ = image->header.stamp;
    size_ = cv::Size(static_cast<int>(image->width), static_cast<int>(image->height));
  }
  for (const auto& homography : content.homographies) follow(*homography);
  publishDue();
}

// It has a connection of its own, and drivers publish it after the image: that may be long out.
void StabilizerNodelet::take(const sensor_msgs::CameraInfoConstPtr& info) {
  const ros::Time stamp = info->header.stamp;
  if (without_info_.take(stamp)) {
    info_pub_.publish(*info);
  } else {
    infos_.put(stamp, info);
  }
}

void StabilizerNodelet::follow(const HomographyStamped& message) {
  if (size_.empty()) return;  // no image was seen yet
  ready_.clear();
  stabilizer_.add(stampOf(message.header.stamp), stampOf(message.reference_stamp),
                  homographyOf(message), size_, ready_);
  for (const SteadyFrame& frame : ready_) {
    due_.push_back(frame);
    if (frame.starts_anew) ++restarts_;
  }
  monitor_.setValue("starts anew", std::to_string(restarts_));
}

// Over a network an image may come after its homography: it is waited for until a newer one is
// there. A worker that is behind leaves out all but the newest.
void StabilizerNodelet::publishDue() {
  const std::size_t most = static_cast<std::size_t>(stabilizer_.options().lag) + 2;
  std::size_t complete = 0;
  for (const SteadyFrame& frame : due_) complete += images_.find(timeOf(frame.stamp)) ? 1 : 0;
  while (!due_.empty()) {
    const SteadyFrame frame = due_.front();
    const ros::Time stamp = timeOf(frame.stamp);
    const auto image = images_.take(stamp);
    if (!image && newest_ <= stamp && due_.size() <= kImages) return;
    due_.pop_front();
    if (!image || complete-- > most) {
      monitor_.dropped(1);
      continue;
    }
    publish(frame, *image);
  }
}

void StabilizerNodelet::publish(const SteadyFrame& frame, const sensor_msgs::ImageConstPtr& image) {
  const ros::Time stamp = image->header.stamp;
  if (const auto info = infos_.take(stamp)) {
    info_pub_.publish(*info);
  } else {
    without_info_.put(stamp, true);
  }
  if (image_pub_.getNumSubscribers() == 0) return;
  const auto start = std::chrono::steady_clock::now();
  try {
    image_pub_.publish(warped(image, frame.warp));
  } catch (const RefusedImage& error) {
    refuse(error.what());
    return;
  }
  monitor_.done(
      std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - start).count());
}

}  // namespace ktgp_orb

PLUGINLIB_EXPORT_CLASS(ktgp_orb::StabilizerNodelet, nodelet::Nodelet)
