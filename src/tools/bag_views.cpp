#include "tools/bag_views.h"

#include <Eigen/LU>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <opencv2/core/eigen.hpp>
#include <opencv2/imgproc.hpp>

#include "messages/colour_image.h"

namespace ktgp_orb {
namespace {

constexpr double kRate = 30.0;  // 1/s, of the video

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

BagViews::BagViews(const ViewOptions& options)
    : options_(options), stabilizer_(options.stabilizer), mosaic_(options.map) {
  if (!options.stabilized.empty()) video_.emplace(options.stabilized, kRate);
}

void BagViews::add(const sensor_msgs::ImageConstPtr& image, const HomographyStamped& message) {
  std::optional<Eigen::Matrix3d> h;
  if (message.status == HomographyStamped::STATUS_OK) {
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

void BagViews::close() {
  if (video_) {
    stabilizer_.flush(ready_);
    writeReady();
    shake_before_.add(before_, size_);
    shake_after_.add(after_, size_);
    video_->close();
    if (!options_.warps.empty()) {
      tools::writeText(options_.warps,
                       "stamp,starts_anew,h00,h01,h02,h10,h11,h12,h20,h21,h22\n" + warps_);
    }
  }
  if (!options_.mosaic.empty()) tools::writeImage(options_.mosaic, mosaic_.image());
  if (!options_.mosaic_poses.empty()) {
    tools::writeText(options_.mosaic_poses,
                     "stamp,placement,map,h00,h01,h02,h10,h11,h12,h20,h21,h22\n" + poses_);
  }
}

std::string BagViews::report() const {
  char line[256];
  std::string text;
  if (video_) {
    std::snprintf(line, sizeof line,
                  "%s: %zu frames, shake %.3f px^2 before, %.3f after, %d frames late, %.2f ms a "
                  "frame\n",
                  options_.stabilized.c_str(), frames_, shake_before_.mean(), shake_after_.mean(),
                  options_.stabilizer.lag,
                  warp_milliseconds_ / static_cast<double>(std::max<std::size_t>(frames_, 1)));
    text += line;
  }
  if (!options_.mosaic.empty()) {
    std::snprintf(line, sizeof line,
                  "%s: %dx%d px, %zu frames, %zu of them lost, %zu keyframes, %zu maps begun, "
                  "%.2f ms a frame%s\n",
                  options_.mosaic.c_str(), mosaic_.area().width, mosaic_.area().height, placed_,
                  lost_, mosaic_.keyframes(), mosaic_.maps(),
                  place_milliseconds_ / static_cast<double>(std::max<std::size_t>(placed_, 1)),
                  mosaic_.full() ? "; full, some was left out" : "");
    text += line;
  }
  return text;
}

}  // namespace ktgp_orb
