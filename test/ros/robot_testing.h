#pragma once

#include <dynamic_reconfigure/Reconfigure.h>
#include <gtest/gtest.h>
#include <nodelet/loader.h>
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/image_encodings.h>

#include <atomic>
#include <boost/make_shared.hpp>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "orb_test_images.h"

/// Common code of the tests that load the nodelet into their own process: the sanitizers then see
/// all of it, and pointers can be compared on both sides.
namespace ktgp_orb::test {

constexpr double kTimeout = 180.0;  // s; limit for everything expected on a busy machine

/// Waits for a condition of the live system; false after kTimeout.
inline bool waitUntil(const std::function<bool()>& condition) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::duration<double>(kTimeout);
  while (!condition()) {
    if (std::chrono::steady_clock::now() > end) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  return true;
}

/// A grey image as a camera sends it.
inline sensor_msgs::ImagePtr imageMessage(const cv::Mat& image, const ros::Time& stamp) {
  auto message = boost::make_shared<sensor_msgs::Image>();
  message->header.stamp = stamp;
  message->header.frame_id = "camera";
  message->encoding = sensor_msgs::image_encodings::MONO8;
  message->width = static_cast<std::uint32_t>(image.cols);
  message->height = static_cast<std::uint32_t>(image.rows);
  message->step = message->width;
  message->data.resize(image.total());
  image.copyTo(cv::Mat(image.size(), CV_8U, message->data.data()));
  return message;
}

/// Calibration of a camera whose principal point is the middle of its images, with one number of
/// distortion.
inline sensor_msgs::CameraInfo calibration(const cv::Size& size, double focal, double k1 = 0.0) {
  sensor_msgs::CameraInfo info;
  info.header.frame_id = "camera";
  info.width = static_cast<std::uint32_t>(size.width);
  info.height = static_cast<std::uint32_t>(size.height);
  info.distortion_model = "plumb_bob";
  info.D = {k1, 0.0, 0.0, 0.0, 0.0};
  info.K = {focal, 0.0, size.width / 2.0, 0.0, focal, size.height / 2.0, 0.0, 0.0, 1.0};
  return info;
}

/// The view of a camera that moves back and forth over the texture, 5 px right and 3 px down per
/// frame. It comes back a pixel below: with dropped frames, two in a row would show the same image.
class View {
 public:
  explicit View(const cv::Size& size)
      : size_(size), texture_(textureImage({size.width + 200, size.height + 120}, 1)) {}

  sensor_msgs::ImagePtr image(int number, const ros::Time& stamp) const {
    const int step = std::abs(number % 80 - 40);
    const int below = number % 80 > 40 ? 1 : 0;
    auto message = imageMessage(texture_(cv::Rect({5 * step, 3 * step + below}, size_)), stamp);
    message->header.seq = static_cast<std::uint32_t>(number);
    return message;
  }

 private:
  cv::Size size_;
  cv::Mat texture_;
};

/// Publishes views from its own thread, within the process: no image is copied.
class Camera {
 public:
  Camera(const std::string& topic, const cv::Size& size, double rate)
      : view_(size),
        rate_(rate),
        publisher_(ros::NodeHandle().advertise<sensor_msgs::Image>(topic, 1)) {}
  ~Camera() { stop(); }

  void start() {
    running_ = true;
    thread_ = std::thread([this] { run(); });
  }
  void stop() {
    running_ = false;
    if (thread_.joinable()) thread_.join();
  }
  void setRate(double rate) { rate_ = rate; }
  int count() const { return count_; }
  /// Publishes one view and holds it.
  sensor_msgs::ImageConstPtr publish() {
    const sensor_msgs::ImageConstPtr image = view_.image(count_++, ros::Time::now());
    if (keep_) {
      const std::lock_guard<std::mutex> lock(mutex_);
      kept_.push_back(image);
    }
    publisher_.publish(image);
    return image;
  }
  void publishAgain(const sensor_msgs::ImageConstPtr& image) { publisher_.publish(image); }
  /// After this call every image is kept.
  void keep() { keep_ = true; }
  std::vector<sensor_msgs::ImageConstPtr> kept() {
    const std::lock_guard<std::mutex> lock(mutex_);
    return kept_;
  }
  std::uint32_t subscribers() const { return publisher_.getNumSubscribers(); }

 private:
  void run() {
    auto next = std::chrono::steady_clock::now();
    while (running_) {
      publish();
      next += std::chrono::duration_cast<std::chrono::steady_clock::duration>(
          std::chrono::duration<double>(1.0 / rate_));
      next = std::max(next, std::chrono::steady_clock::now() - std::chrono::milliseconds(50));
      std::this_thread::sleep_until(next);
    }
  }

  View view_;
  std::atomic<double> rate_;
  ros::Publisher publisher_;
  std::atomic<bool> running_{false};
  std::atomic<int> count_{0};
  std::atomic<bool> keep_{false};
  std::mutex mutex_;  // guards kept_
  std::vector<sensor_msgs::ImageConstPtr> kept_;
  std::thread thread_;
};

/// Keeps every message of a topic.
template <typename Message>
class Recorder {
 public:
  using Ptr = boost::shared_ptr<const Message>;

  explicit Recorder(const std::string& topic) {
    node_.setCallbackQueue(&queue_);
    subscriber_ = node_.subscribe<Message>(
        topic, 0, [this](const Ptr& message) { messages_.push_back(message); });
  }
  /// Everything that has arrived so far.
  const std::vector<Ptr>& messages() {
    queue_.callAvailable();
    return messages_;
  }
  void clear() { messages_.clear(); }
  /// The message of a stamp, or null.
  Ptr withStamp(const ros::Time& stamp) {
    for (const Ptr& message : messages()) {
      if (message->header.stamp == stamp) return message;
    }
    return nullptr;
  }
  bool waitFor(const ros::Time& stamp) {
    return waitUntil([&] { return withStamp(stamp) != nullptr; });
  }
  bool waitForMore(std::size_t count) {
    const std::size_t wanted = messages().size() + count;
    return waitUntil([&] { return messages().size() >= wanted; });
  }

 private:
  ros::CallbackQueue queue_;
  ros::NodeHandle node_;
  std::vector<Ptr> messages_;
  ros::Subscriber subscriber_;
};

/// Loads the matcher as CAMERA/matcher, fed by CAMERA/image_raw.
inline bool loadMatcher(nodelet::Loader& loader, const std::string& camera) {
  return loader.load(camera + "/matcher", "ktgp_orb/matcher",
                     {{camera + "/image", camera + "/image_raw"}}, {});
}

/// A message to dynamic_reconfigure.
class Change {
 public:
  Change& set(const std::string& name, double value) { return add(config_.doubles, name, value); }
  Change& set(const std::string& name, int value) { return add(config_.ints, name, value); }
  Change& set(const std::string& name, bool value) { return add(config_.bools, name, value); }
  Change& set(const std::string& name, const std::string& value) {
    return add(config_.strs, name, value);
  }
  /// False if the nodelet was just unloaded.
  bool send(const std::string& nodelet) const {
    dynamic_reconfigure::Reconfigure call;
    call.request.config = config_;
    return ros::service::call(nodelet + "/set_parameters", call);
  }

 private:
  template <typename Parameters, typename Value>
  Change& add(Parameters& parameters, const std::string& name, const Value& value) {
    parameters.emplace_back();
    parameters.back().name = name;
    parameters.back().value = value;
    return *this;
  }

  dynamic_reconfigure::Config config_;
};

inline std::vector<std::string> arguments;  // arguments of the command line

/// The value after `--name=` on the command line.
template <typename Number>
Number argument(const std::string& name, Number otherwise) {
  const std::string prefix = "--" + name + "=";
  for (const std::string& text : arguments) {
    if (text.compare(0, prefix.size(), prefix) == 0) {
      return static_cast<Number>(std::stod(text.substr(prefix.size())));
    }
  }
  return otherwise;
}

}  // namespace ktgp_orb::test
