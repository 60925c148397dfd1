#include <image_transport/camera_common.h>
#include <ktgp_orb/MosaicConfig.h>
#include <ktgp_orb/SaveMosaic.h>
#include <sensor_msgs/CameraInfo.h>
#include <std_srvs/Trigger.h>
#include <pluginlib/class_list_macros.hpp>

#include <chrono>
#include <deque>

#include "files/output_file.h"
#include "ktgp_orb/mosaic.h"
#include "nodelet/frame_consumer.h"
#include "ros/camera.h"
#include "ros/image_conversion.h"
#include "ros/message_conversion.h"
#include "util/format.h"

namespace ktgp_orb {
namespace {

using Clock = std::chrono::steady_clock;
using std_srvs::Trigger;

constexpr std::chrono::seconds kPeriod{1};  // shortest time between published pictures

MosaicOptions optionsFrom(const MosaicConfig& config) {
  MosaicOptions options;
  options.max_megapixels = config.max_megapixels;
  return options;
}

std::string withOneDigit(double value) {
  return util::format("%.1f", value);
}

}  // namespace

/// Builds the map, and publishes its pictures and poses.
class MosaicWork {
 public:
  MosaicWork(Diagnosis& diagnosis, image_transport::Publisher pictures, const ros::Publisher& poses,
             const std::string& image_topic)
      : diagnosis_(diagnosis),
        pictures_(std::move(pictures)),
        poses_(poses),
        pixels_(pixelsFrom("by_name", image_topic)) {}

  void configure(const MosaicConfig& config);
  void addCameraInfo(const sensor_msgs::CameraInfoConstPtr& info) { info_ = info; }
  void add(const sensor_msgs::ImageConstPtr& image) {
    diagnosis_.count(Diagnosis::kForgotten, images_.put(image));
    size_ = sizeOf(*image);
  }
  void follow(const HomographyStampedConstPtr& message);
  void finish();
  void restart() {
    images_.clear();
    info_.reset();
  }
  void reset() { mosaic_.reset(); }
  void publishPicture();
  cv::Mat image() const { return mosaic_.image(); }

 private:
  void place(const HomographyStamped& message, const sensor_msgs::ImageConstPtr& image);
  void report();

  Diagnosis& diagnosis_;
  ImageStore images_;
  image_transport::Publisher pictures_;
  ros::Publisher poses_;
  Mosaic mosaic_;
  Pixels pixels_;
  sensor_msgs::CameraInfoConstPtr info_;  // null: none has arrived yet
  cv::Size size_;                         // size of the newest image
  MosaicConfig config_;
  std_msgs::Header last_header_;                    // header of the last placed image
  std::deque<HomographyStampedConstPtr> unplaced_;  // homographies whose images may still arrive
  Clock::time_point last_picture_;
};

void MosaicWork::configure(const MosaicConfig& config) {
  config_ = config;
  mosaic_.setOptions(optionsFrom(config));
}

/// Passes the homography to the mosaic even if its image will be skipped, because the homographies
/// form a chain from frame to frame.
void MosaicWork::follow(const HomographyStampedConstPtr& message) {
  if (size_.empty()) return;  // no image was seen yet
  // Skip a frame whose stamp went back. If only its stamp is wrong, the next frame continues the
  // chain of homographies. If the recording was looped, the next frame starts a new chain.
  if (message->reason == MatchStatus::REASON_STAMP_WENT_BACK) return;
  mosaic_.follow(stampOf(message->header.stamp), stampOf(message->reference_stamp),
                 homographyOf(*message, size_));
  unplaced_.push_back(message);
  while (unplaced_.size() > ImageStore::kImages) unplaced_.pop_front();
}

/// Places the newest image that has a homography; if the worker is late, it skips older images.
void MosaicWork::finish() {
  for (std::size_t i = unplaced_.size(); i-- > 0;) {
    const HomographyStampedConstPtr message = unplaced_[i];
    const auto image = images_.take(message->header.stamp);
    if (!image) continue;
    const auto end = unplaced_.begin() + static_cast<std::ptrdiff_t>(i) + 1;
    unplaced_.erase(unplaced_.begin(), end);
    diagnosis_.count(Diagnosis::kDropped, i);
    place(*message, image);
    return;
  }
}

void MosaicWork::place(const HomographyStamped& message, const sensor_msgs::ImageConstPtr& image) {
  const cv::Mat colour = colourImage(image);
  const auto start = Clock::now();
  mosaic_.setCamera(info_ ? cameraIfUsable(*info_, pixels_, colour.size()) : std::nullopt);
  diagnosis_.setValue("last frame", toString(mosaic_.place(stampOf(message.header.stamp), colour)));
  last_header_ = message.header;
  if (poses_.getNumSubscribers() > 0) {
    const auto pose = toHomography(message.header, timeOf(mosaic_.firstStamp()), mosaic_.pose(),
                                   colour.size(), {});
    pose->rectified = message.rectified;
    poses_.publish(pose);
  }
  diagnosis_.done(message.header.stamp, start);
  report();
  if (pictures_.getNumSubscribers() > 0 && Clock::now() - last_picture_ >= kPeriod) {
    last_picture_ = Clock::now();
    publishPicture();
  }
}

void MosaicWork::report() {
  diagnosis_.setValue("megapixels", withOneDigit(mosaic_.megapixels()));
  diagnosis_.setValue("keyframes", std::to_string(mosaic_.keyframes()));
  diagnosis_.setValue("maps begun", std::to_string(mosaic_.maps()));
  diagnosis_.setValue("deviation from a plane (px)", withOneDigit(mosaic_.planeDeviation()));
  diagnosis_.setProblem("parallax",
                        mosaic_.hasParallax()
                            ? std::string(mosaic_.panorama() ? "the camera does not only turn"
                                                             : "the scene is no plane") +
                                  ": points are about " + withOneDigit(mosaic_.planeDeviation()) +
                                  " px off the map, and what is near is drawn several times"
                            : "",
                        false);
  diagnosis_.setProblem("repetition",
                        mosaic_.lostBecause() == LostBecause::repeats
                            ? "the ground repeats: frames that fit in several places are lost"
                            : "");
  diagnosis_.setProblem("surface", mosaic_.whyLost());
  const auto panorama = mosaic_.panorama();
  diagnosis_.setValue("drawn on", panorama
                                      ? util::format("a cylinder, %.0f degrees", panorama->degrees)
                                      : std::string("a plane"));
  diagnosis_.setProblem("full", mosaic_.full() ? "the mosaic, or the rectangle around it, is full "
                                                 "(max_megapixels): it does not grow any more"
                                               : "");
}

void MosaicWork::publishPicture() {
  const cv::Mat picture = mosaic_.picture(config_.picture_size);
  if (!picture.empty()) pictures_.publish(toImage(last_header_, "bgr8", picture));
}

/// Takes images and homographies, and publishes a growing mosaic. doc/views.md describes topics,
/// services and parameters.
class MosaicNodelet : public FrameConsumer<MosaicConfig, MosaicWork> {
 public:
  ~MosaicNodelet() override { stop(); }

 private:
  static constexpr std::size_t kCameraInfo = 3;  // kind of job; the base class defines 1 and 2

  void addOwnInputs() override;
  std::string nodelet() const override { return "mosaic"; }
  void configure(MosaicConfig& config) override;
  void advertise() override;
  bool isWanted() const override { return !lazy_ || outputs_.haveSubscribers(); }
  std::string whyEmpty();
  void save(const SaveMosaic::Request& request, SaveMosaic::Response& response);

  std::atomic<bool> lazy_{false};
};

void MosaicNodelet::addOwnInputs() {
  addInput<sensor_msgs::CameraInfo>(image_transport::getCameraInfoTopic(images_->topic()),
                                    "camera_info", 1, false,
                                    [this](const sensor_msgs::CameraInfoConstPtr& info) {
                                      worker_.put<&MosaicWork::addCameraInfo>(kCameraInfo, 0, info);
                                    });
  worker_.setLimits(kCameraInfo, 1);
}

void MosaicNodelet::configure(MosaicConfig& config) {
  worker_.post([config](MosaicWork& work) { work.configure(config); });
  lazy_ = config.lazy;
  connectionsChanged();
}

void MosaicNodelet::advertise() {
  const auto pictures = outputs_.advertiseImage(
      "mosaic", 1, true, [this] { worker_.post([](MosaicWork& work) { work.publishPicture(); }); });
  const auto poses = outputs_.advertise<HomographyStamped>("homography", 10);
  addService<SaveMosaic>("save", long_queue_, [this](auto& request, auto& response) {
    save(request, response);  // in long_queue_, because saving takes a while
  });
  addService<Trigger>("reset", service_queue_, [this](auto& /*request*/, auto& response) {
    worker_.post([](MosaicWork& work) { work.reset(); });
    response.message = "the next frame begins a new map";
  });
  startWorker(std::make_unique<MosaicWork>(diagnosis_, pictures, poses, images_->topic()));
}

void MosaicNodelet::save(const SaveMosaic::Request& request, SaveMosaic::Response& response) {
  const std::string& file = request.file;
  if (file.empty() || file[0] != '/' || file.size() < 5 || file.substr(file.size() - 4) != ".png") {
    throw std::invalid_argument("file is '" + file +
                                "'; expected an absolute path that ends in .png");
  }
  const cv::Mat picture = worker_.ask([](MosaicWork& work) { return work.image(); });
  if (picture.empty()) throw std::runtime_error("there is no mosaic yet: " + whyEmpty());
  files::writeImage(file, picture, true);
  response.message = file;
  response.width = static_cast<std::uint32_t>(picture.cols);
  response.height = static_cast<std::uint32_t>(picture.rows);
}

std::string MosaicNodelet::whyEmpty() {
  if (!isListening()) return "lazy is on, and no output has a subscriber: no image is received";
  const std::uint64_t images = images_->arrived();
  const std::uint64_t homographies = homographies_->arrived();
  if (images == 0) return "no image has arrived on " + images_->topic();
  if (homographies == 0) {
    return "no homography has arrived on " + homographies_->topic() + ": is the matcher running?";
  }
  return "of " + std::to_string(images) + " images, none was placed; " +
         std::to_string(diagnosis_.total("homographies found")) + " of " +
         std::to_string(homographies) + " homographies were found";
}

}  // namespace ktgp_orb

PLUGINLIB_EXPORT_CLASS(ktgp_orb::MosaicNodelet, nodelet::Nodelet)
