#include "tools/bag_views.h"

#include <ktgp_orb/MatchStatus.h>

#include <Eigen/LU>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <opencv2/core/eigen.hpp>
#include <opencv2/imgproc.hpp>

#include "messages/colour_image.h"

namespace ktgp_orb {
namespace {

constexpr double kRate = 30.0;  // 1/s, rate of the video

std::int64_t nanoseconds(const ros::Time& time) {
  return static_cast<std::int64_t>(time.toNSec());
}

/// "sec.nsec"
std::string text(const ros::Time& time) {
  char buffer[32];
  std::snprintf(buffer, sizeof buffer, "%u.%09u", time.sec, time.nsec);
  return buffer;
}

/// ",h00,h01,...,h22" and the end of the line.
std::string text(const Eigen::Matrix3d& h) {
  std::string row;
  char buffer[32];
  for (int i = 0; i < 9; ++i) {
    std::snprintf(buffer, sizeof buffer, ",%.17g", h(i / 3, i % 3));
    row += buffer;
  }
  return row + '\n';
}

class Stopwatch {
 public:
  double milliseconds() const {
    return std::chrono::duration<double, std::milli>(Clock::now() - start_).count();
  }

 private:
  using Clock = std::chrono::steady_clock;
  Clock::time_point start_ = Clock::now();
};

}  // namespace

void BagViews::Shake::add(const std::vector<Eigen::Matrix3d>& steps, const cv::Size& size) {
  if (steps.size() < 2) return;
  const double weight = static_cast<double>(steps.size() - 1);
  sum += weight * shakeOf(steps, size);
  count += weight;
}

std::string mosaicOf(const std::string& path, std::size_t number) {
  if (number == 1) return path;
  const std::filesystem::path first(path);
  const std::string name =
      first.stem().string() + "-" + std::to_string(number) + first.extension().string();
  return (first.parent_path() / name).string();
}

BagViews::BagViews(const ViewOptions& options)
    : options_(options), stabilizer_(options.stabilizer), mosaic_(options.map) {
  if (!options.stabilized.empty()) video_.emplace(options.stabilized, kRate, options.force);
  if (!options.mosaic.empty()) {
    mosaic_.onFinishedMap([this](const cv::Mat& image) { writeMap(image); });
  }
}

void BagViews::add(const sensor_msgs::ImageConstPtr& image, const HomographyStamped& message) {
  std::optional<Eigen::Matrix3d> h;
  if (message.status == MatchStatus::STATUS_OK) {
    h = Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(message.homography.data());
  }
  if (video_) stabilize(image, message, h);
  if (options_.mosaic.empty()) return;
  const std::int64_t stamp = nanoseconds(image->header.stamp);
  const Stopwatch watch;
  mosaic_.follow(stamp, nanoseconds(message.reference_stamp), h);
  const Placement placement = mosaic_.place(stamp, colourImage(image));
  place_milliseconds_ += watch.milliseconds();
  ++placed_;
  lost_ += placement == Placement::lost ? 1 : 0;
  if (options_.mosaic_poses.empty()) return;
  poses_ += text(image->header.stamp) + ',' + toString(placement) + ',' +
            std::to_string(mosaic_.maps()) + text(mosaic_.pose().value_or(Eigen::Matrix3d::Zero()));
}

void BagViews::stabilize(const sensor_msgs::ImageConstPtr& image, const HomographyStamped& message,
                         const std::optional<Eigen::Matrix3d>& h) {
  const std::int64_t stamp = nanoseconds(image->header.stamp);
  const std::int64_t reference = nanoseconds(message.reference_stamp);
  const cv::Mat frame = colourImage(image);
  waiting_[stamp] = frame.clone();
  if (h && reference == last_stamp_) steps_[stamp] = *h;
  last_stamp_ = stamp;
  stabilizer_.add(stamp, reference, h, frame.size(), ready_);
  writeReady();
}

void BagViews::writeReady() {
  for (const SteadyFrame& steady : ready_) {
    const cv::Mat frame = waiting_[steady.stamp];
    waiting_.erase(steady.stamp);
    const Stopwatch watch;
    cv::Mat homography;
    cv::eigen2cv(steady.warp, homography);
    cv::Mat picture;
    cv::warpPerspective(frame, picture, homography, frame.size(), cv::INTER_LINEAR,
                        cv::BORDER_REPLICATE);
    warp_milliseconds_ += watch.milliseconds();
    ++frames_;
    video_->write(picture);
    if (!options_.warps.empty()) {
      ros::Time stamp;
      stamp.fromNSec(static_cast<std::uint64_t>(steady.stamp));
      warps_ += text(stamp) + (steady.starts_anew ? ",1" : ",0") + text(steady.warp);
    }

    const auto step = steps_.find(steady.stamp);
    const bool follows = step != steps_.end() && last_steady_ && !steady.starts_anew;
    if (follows) {
      before_.push_back(step->second);
      after_.emplace_back(steady.warp * step->second * last_steady_->warp.inverse());
    } else {
      shake_before_.add(before_, frame.size());
      shake_after_.add(after_, frame.size());
      before_.clear();
      after_.clear();
    }
    if (step != steps_.end()) steps_.erase(step);
    last_steady_ = steady;
    size_ = frame.size();
  }
  ready_.clear();
}

void BagViews::writeMap(const cv::Mat& image) {
  const std::string path = mosaicOf(options_.mosaic, maps_.size() + 1);
  maps_.push_back(std::make_unique<tools::OutputFile>(path, options_.force));
  tools::writeImage(*maps_.back(), image);
}

void BagViews::close() {
  const cv::Mat map = options_.mosaic.empty() ? cv::Mat() : mosaic_.image();
  if (!map.empty()) writeMap(map);
  for (const auto& file : maps_) file->commit();
  if (video_) {
    stabilizer_.flush(ready_);
    writeReady();
    shake_before_.add(before_, size_);
    shake_after_.add(after_, size_);
    if (!video_->empty()) video_->close();
    if (!options_.warps.empty()) {
      tools::writeText(options_.warps,
                       "stamp,starts_anew,h00,h01,h02,h10,h11,h12,h20,h21,h22\n" + warps_,
                       options_.force);
    }
  }
  if (!options_.mosaic_poses.empty()) {
    tools::writeText(options_.mosaic_poses,
                     "stamp,placement,map,h00,h01,h02,h10,h11,h12,h20,h21,h22\n" + poses_,
                     options_.force);
  }
}

std::string BagViews::report() const {
  char line[256];
  std::string text;
  if (video_ && frames_ == 0) {
    text += options_.stabilized + ": not written, since no image could be used\n";
  } else if (video_) {
    std::snprintf(line, sizeof line,
                  "%s: %zu frames, shake %.3f px^2 before, %.3f after, %d frames late, %.2f ms a "
                  "frame\n",
                  options_.stabilized.c_str(), frames_, shake_before_.mean(), shake_after_.mean(),
                  options_.stabilizer.lag,
                  warp_milliseconds_ / static_cast<double>(std::max<std::size_t>(frames_, 1)));
    text += line;
  }
  if (!options_.mosaic.empty() && maps_.empty()) {
    text += options_.mosaic + ": not written, since no image could be used\n";
  } else if (!options_.mosaic.empty()) {
    text += options_.mosaic;
    if (maps_.size() > 1) {
      text += " to " + mosaicOf(options_.mosaic, maps_.size()) + ": " +
              std::to_string(maps_.size()) + " maps, each in a file; the last";
    }
    std::snprintf(line, sizeof line,
                  ": %dx%d px; %zu frames, %zu of them lost, %zu keyframes, %.2f ms a frame%s\n",
                  mosaic_.area().width, mosaic_.area().height, placed_, lost_, mosaic_.keyframes(),
                  place_milliseconds_ / static_cast<double>(std::max<std::size_t>(placed_, 1)),
                  mosaic_.full() ? "; full, some was left out" : "");
    text += line;
  }
  return text;
}

}  // namespace ktgp_orb
