#include <ktgp_orb/MatchStatus.h>
#include <ktgp_orb/StabilizerConfig.h>
#include <pluginlib/class_list_macros.hpp>

#include <Eigen/Core>
#include <boost/make_shared.hpp>
#include <chrono>
#include <deque>
#include <limits>
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

StabilizerOptions optionsFrom(const StabilizerConfig& config) {
  StabilizerOptions options;
  options.strength = config.strength;
  options.lag = config.lag;
  options.max_crop = config.max_crop;
  return options;
}

/// The warped frame, with the header of the frame.
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

/// Images and homographies in, a steady image out. doc/views.md describes topics and parameters.
class StabilizerNodelet : public FrameConsumer {
 public:
  ~StabilizerNodelet() override {
    stop();
    shutdown();
  }

 private:
  void configure() override;
  void advertise() override;
  void shutdown() override;
  void work(FrameInbox::Content& content) override;
  void restart() override;
  void follow(const HomographyStamped& message);
  void publishDue();
  void publish(const SteadyFrame& frame, const sensor_msgs::ImageConstPtr& image);
  void publishWarp(const SteadyFrame& frame, const std_msgs::Header& header);

  image_transport::Publisher image_pub_;
  ros::Publisher warp_pub_;
  std::unique_ptr<dynamic_reconfigure::Server<StabilizerConfig>> server_;

  std::mutex mutex_;  // guards options_
  StabilizerOptions options_;

  // Used only by the worker
  Stabilizer stabilizer_;
  cv::Size size_;     // of the newest image
  ros::Time newest_;  // its stamp
  std::uint64_t restarts_ = 0;
  bool rectified_ = false;  // the pixels of the newest homography
  std::vector<SteadyFrame> ready_;
  std::deque<SteadyFrame> due_;  // whose image may still arrive
};

void StabilizerNodelet::configure() {
  server_ = serveParameters<StabilizerConfig>([this](const StabilizerConfig& config) {
    const Lock lock(mutex_);
    options_ = optionsFrom(config);
  });
}

void StabilizerNodelet::advertise() {
  image_pub_ = outputs_.advertiseImage("image", 2);
  warp_pub_ = outputs_.advertise<HomographyStamped>("warp", 10);
}

void StabilizerNodelet::shutdown() {
  server_.reset();
}

void StabilizerNodelet::restart() {
  stabilizer_.reset();
  images_.clear();
  due_.clear();
  size_ = {};
}

void StabilizerNodelet::work(FrameInbox::Content& content) {
  {
    const Lock lock(mutex_);
    stabilizer_.setOptions(options_);
    images_.setMost(kImages + static_cast<std::size_t>(options_.lag));
  }
  for (const auto& image : content.images) {
    keep(image);
    newest_ = image->header.stamp;
    size_ = cv::Size(static_cast<int>(image->width), static_cast<int>(image->height));
  }
  content.images.clear();
  for (const auto& homography : content.homographies) follow(*homography);
  publishDue();
}

void StabilizerNodelet::follow(const HomographyStamped& message) {
  if (size_.empty()) return;  // no image was seen yet
  ready_.clear();
  rectified_ = message.rectified != 0;
  stabilizer_.add(stampOf(message.header.stamp), stampOf(message.reference_stamp),
                  homographyOf(message), size_, ready_);
  for (const SteadyFrame& frame : ready_) {
    due_.push_back(frame);
    if (frame.starts_anew) ++restarts_;
  }
  monitor_.setValue("restarts", std::to_string(restarts_));
}

// Over a network an image may arrive after its homography: wait for it until a newer one arrives. A
// late worker skips all but the newest.
void StabilizerNodelet::publishDue() {
  const std::size_t most = static_cast<std::size_t>(stabilizer_.options().lag) + 2;
  std::size_t complete = 0;
  for (const SteadyFrame& frame : due_) complete += images_.has(timeOf(frame.stamp)) ? 1 : 0;
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
    publish(frame, image);
  }
}

void StabilizerNodelet::publish(const SteadyFrame& frame, const sensor_msgs::ImageConstPtr& image) {
  if (warp_pub_.getNumSubscribers() > 0) publishWarp(frame, image->header);
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

/// From pixels of the image to pixels of the steady image.
void StabilizerNodelet::publishWarp(const SteadyFrame& frame, const std_msgs::Header& header) {
  auto warp = boost::make_shared<HomographyStamped>();
  warp->header = header;
  warp->reference_stamp = header.stamp;
  warp->status = MatchStatus::STATUS_OK;
  warp->rectified = rectified_;
  Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(warp->homography.data()) = frame.warp;
  warp->covariance.fill(std::numeric_limits<double>::quiet_NaN());
  warp_pub_.publish(warp);
}

}  // namespace ktgp_orb

PLUGINLIB_EXPORT_CLASS(ktgp_orb::StabilizerNodelet, nodelet::Nodelet)
