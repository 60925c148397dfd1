#include "tools/steady_video.h"

#include <Eigen/LU>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "core/util/format.h"
#include "core/util/milliseconds.h"
#include "files/csv.h"
#include "files/input.h"
#include "messages/image_conversion.h"
#include "messages/message_conversion.h"
#include "stabilization/steady_path.h"
#include "tools/view_text.h"

namespace ktgp_orb {
namespace {

constexpr std::size_t kPath = 600;  // frames, within which a keyframe is known
constexpr double kNoShake = 0.5;    // px, below which nobody sees it

}  // namespace

void SteadyVideo::Shake::finishPart(const cv::Size& size) {
  if (steps.size() >= 2) {
    const double weight = static_cast<double>(steps.size() - 1);
    sum += weight * shakeOf(steps, size);
    count += weight;
  }
  steps.clear();
}

SteadyVideo::SteadyVideo(const ViewOptions& options, Reopen reopen)
    : options_(options),
      reopen_(std::move(reopen)),
      video_(options.video, options.rate, options.force),
      path_(kPath),
      stabilizer_(options.stabilizer) {}

void SteadyVideo::add(const sensor_msgs::ImageConstPtr& image, std::int64_t stamp,
                      std::int64_t reference, const std::optional<Eigen::Matrix3d>& homography) {
  const cv::Mat frame = colourImage(image);
  const std::optional<std::int64_t> previous =
      path_.steps().empty() ? std::nullopt : std::make_optional(path_.steps().back().stamp);
  std::optional<Eigen::Matrix3d> step;
  if (path_.add(stamp, reference, homography) && previous) step = path_.between(*previous, stamp);
  if (options_.whole) {
    frames_.push_back({stamp, frame.size(), step});
    return;
  }
  waiting_[stamp] = {frame.clone(), step};
  stabilizer_.add(stamp, reference, homography, frame.size(), ready_);
  writeReady();
}

void SteadyVideo::writeReady() {
  for (const SteadyFrame& steady : ready_) {
    const auto& [frame, step] = waiting_[steady.stamp];
    write(steady, frame, step);
    waiting_.erase(steady.stamp);
  }
  ready_.clear();
}

/// Frames of another size begin a path of their own.
std::vector<SteadyFrame> SteadyVideo::wholePath() const {
  std::vector<SteadyFrame> path;
  for (auto begin = frames_.begin(); begin != frames_.end();) {
    const auto end = std::find_if(
        begin, frames_.end(), [&begin](const Frame& frame) { return frame.size != begin->size; });
    std::vector<std::optional<Eigen::Matrix3d>> steps;
    std::transform(begin, end, std::back_inserter(steps),
                   [](const Frame& frame) { return frame.step; });
    steps.front().reset();
    const auto warps = steadyPath(steps, begin->size, options_.stabilizer.max_crop);
    for (std::size_t i = 0; i < warps.size(); ++i) {
      path.push_back({(begin + static_cast<std::ptrdiff_t>(i))->stamp, warps[i], !steps[i]});
    }
    begin = end;
  }
  return path;
}

void SteadyVideo::writeWhole() {
  const std::vector<SteadyFrame> path = wholePath();
  if (path.empty()) return;
  const std::unique_ptr<ImageSource> images = reopen_();
  std::size_t next = 0;
  while (next < path.size()) {
    const auto recorded = images->next();
    if (!recorded) throw files::FileError(options_.video, "the recording has changed meanwhile");
    if (!recorded->image) continue;
    // Images that were skipped or refused have no place in the path.
    if (stampOf(recorded->image->header.stamp) != path[next].stamp) continue;
    cv::Mat frame;
    try {
      frame = colourImage(recorded->image);
    } catch (const RefusedImage&) {
      continue;
    }
    write(path[next], frame, frames_[next].step);
    ++next;
  }
}

void SteadyVideo::write(const SteadyFrame& steady, const cv::Mat& frame,
                        const std::optional<Eigen::Matrix3d>& step) {
  const auto start = std::chrono::steady_clock::now();
  const cv::Mat picture = warped(frame, steady.warp);
  milliseconds_ += util::millisecondsSince(start);
  ++written_;
  video_.write(picture);
  if (!options_.warps.empty()) {
    warps_ += files::CsvRow()
                  .add(textOf(timeOf(steady.stamp)))
                  .add(steady.starts_anew ? 1 : 0)
                  .add(steady.warp)
                  .line();
  }
  if (step && last_ && !steady.starts_anew) {
    before_.steps.push_back(*step);
    after_.steps.emplace_back(steady.warp * *step * last_->warp.inverse());
  } else {
    before_.finishPart(size_);
    after_.finishPart(size_);
  }
  last_ = steady;
  size_ = frame.size();
}

void SteadyVideo::close() {
  if (options_.whole) {
    writeWhole();
  } else {
    stabilizer_.flush(ready_);
    writeReady();
  }
  before_.finishPart(size_);
  after_.finishPart(size_);
  if (!video_.empty()) video_.close();
  if (options_.warps.empty()) return;
  files::writeText(options_.warps,
                   std::string("stamp,starts_anew,") + files::kHomographyColumns + '\n' + warps_,
                   options_.force);
}

std::string SteadyVideo::report() const {
  if (written_ == 0) return options_.video + ": not written, since no image could be used\n";
  const std::string path = options_.whole
                               ? "the path of the whole recording"
                               : std::to_string(options_.stabilizer.lag) + " frames late";
  const double before = std::sqrt(before_.mean());
  return options_.video +
         util::format(": %zu frames, shake %.2f px before%s, %.2f after, %s, %.2f ms a frame\n",
                      written_, before, before < kNoShake ? " (none to remove)" : "",
                      std::sqrt(after_.mean()), path.c_str(),
                      milliseconds_ / static_cast<double>(written_));
}

}  // namespace ktgp_orb
