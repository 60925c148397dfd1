#include <ktgp_orb/StabilizerConfig.h>
#include <pluginlib/class_list_macros.hpp>

#include <Eigen/Core>
#include <deque>
#include <vector>

#include "ktgp_orb/stabilizer.h"
#include "nodelet/frame_consumer.h"
#include "ros/image_conversion.h"
#include "ros/message_conversion.h"

namespace ktgp_orb {
namespace {

StabilizerOptions optionsFrom(const StabilizerConfig& config) {
  StabilizerOptions options;
  options.strength = config.strength;
  options.lag = config.lag;
  options.max_crop = config.max_crop;
  return options;
}

}  // namespace

/// Estimates the path of the camera, and publishes the steady images.
class StabilizerWork {
 public:
  StabilizerWork(Diagnosis& diagnosis, image_transport::Publisher images,
                 const ros::Publisher& warps)
      : diagnosis_(diagnosis), steady_images_(std::move(images)), warps_(warps) {}

  void configure(const StabilizerOptions& options);
  void add(const sensor_msgs::ImageConstPtr& image);
  void follow(const HomographyStampedConstPtr& message);
  void finish();
  void restart();

 private:
  void publish(const SteadyFrame& frame, const sensor_msgs::ImageConstPtr& image);

  Diagnosis& diagnosis_;
  ImageStore images_;
  image_transport::Publisher steady_images_;
  ros::Publisher warps_;
  Stabilizer stabilizer_;
  cv::Size size_;     // size of the newest image
  ros::Time newest_;  // stamp of the newest image
  std::uint64_t restarts_ = 0;
  bool rectified_ = false;  // whether the newest homography is for rectified images
  std::vector<SteadyFrame> ready_;
  std::deque<SteadyFrame> due_;  // frames whose images may still arrive
};

void StabilizerWork::configure(const StabilizerOptions& options) {
  stabilizer_.setOptions(options);
  images_.setLag(static_cast<std::size_t>(options.lag));
}

void StabilizerWork::restart() {
  stabilizer_.reset();
  images_.clear();
  due_.clear();
  size_ = {};
}

void StabilizerWork::add(const sensor_msgs::ImageConstPtr& image) {
  diagnosis_.count(Diagnosis::kForgotten, images_.put(image));
  newest_ = image->header.stamp;
  size_ = sizeOf(*image);
}

void StabilizerWork::follow(const HomographyStampedConstPtr& message) {
  if (size_.empty()) return;  // no image was seen yet
  // Skip a frame whose stamp went back. If only its stamp is wrong, the next frame continues the
  // chain of homographies. If the recording was looped, the next frame starts a new chain.
  if (message->reason == MatchStatus::REASON_STAMP_WENT_BACK) return;
  ready_.clear();
  rectified_ = message->rectified != 0;
  stabilizer_.add(stampOf(message->header.stamp), stampOf(message->reference_stamp),
                  homographyOf(*message, size_), size_, ready_);
  for (const SteadyFrame& frame : ready_) {
    due_.push_back(frame);
    if (frame.starts_anew) ++restarts_;
  }
  diagnosis_.setValue("restarts", std::to_string(restarts_));
}

// Over a network, an image may arrive after its homography, so finish() waits for the image until a
// newer image has arrived. If the worker is late, it processes only the newest frames and skips the
// others.
void StabilizerWork::finish() {
  const std::size_t most = static_cast<std::size_t>(stabilizer_.options().lag) + 2;
  std::size_t complete = 0;
  for (const SteadyFrame& frame : due_) complete += images_.has(timeOf(frame.stamp)) ? 1 : 0;
  while (!due_.empty()) {
    const SteadyFrame frame = due_.front();
    const ros::Time stamp = timeOf(frame.stamp);
    const auto image = images_.take(stamp);
    if (!image && newest_ <= stamp && due_.size() <= ImageStore::kImages) return;
    due_.pop_front();
    if (!image || complete-- > most) {
      diagnosis_.count(Diagnosis::kDropped);
      continue;
    }
    publish(frame, image);
  }
}

/// Publishes the steady image, and the warp that maps pixels of the original image to pixels of the
/// steady image.
void StabilizerWork::publish(const SteadyFrame& frame, const sensor_msgs::ImageConstPtr& image) {
  const auto start = Diagnosis::Clock::now();
  const std_msgs::Header& header = image->header;
  if (warps_.getNumSubscribers() > 0) {
    const cv::Size size = sizeOf(*image);
    const auto warp = toHomography(header, header.stamp, Eigen::Matrix3d(frame.warp), size, size);
    warp->rectified = rectified_;
    warps_.publish(warp);
  }
  if (steady_images_.getNumSubscribers() > 0) {
    try {
      const auto seen = warpableImage(image);
      steady_images_.publish(toImage(header, seen->encoding, warped(seen->image, frame.warp)));
    } catch (const RefusedImage& error) {
      diagnosis_.refuse(error.what());
      return;
    }
  }
  diagnosis_.done(header.stamp, start);
}

/// Stabilizes images with the matcher's homographies. doc/views.md describes topics and parameters.
class StabilizerNodelet : public FrameConsumer<StabilizerConfig, StabilizerWork> {
 public:
  ~StabilizerNodelet() override { stop(); }

 private:
  std::string nodelet() const override { return "stabilizer"; }
  void configure(StabilizerConfig& config) override {
    const StabilizerOptions options = optionsFrom(config);
    worker_.post([options](StabilizerWork& work) { work.configure(options); });
  }
  void advertise() override {
    const auto images = outputs_.advertiseImage("image", 2);
    const auto warps = outputs_.advertise<HomographyStamped>("warp", 10);
    startWorker(std::make_unique<StabilizerWork>(diagnosis_, images, warps));
  }
};

}  // namespace ktgp_orb

PLUGINLIB_EXPORT_CLASS(ktgp_orb::StabilizerNodelet, nodelet::Nodelet)
