#include "tools/bag_views.h"

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <utility>

#include "core/util/format.h"
#include "core/util/milliseconds.h"
#include "files/csv.h"
#include "messages/image_conversion.h"
#include "messages/message_conversion.h"
#include "tools/view_text.h"

namespace ktgp_orb {

std::string mosaicOf(const std::string& path, std::size_t number) {
  if (number == 1) return path;
  const std::filesystem::path first(path);
  const std::string name =
      first.stem().string() + "-" + std::to_string(number) + first.extension().string();
  return (first.parent_path() / name).string();
}

BagViews::BagViews(const ViewOptions& options, Reopen reopen)
    : options_(options), mosaic_(options.map) {
  if (!options.video.empty()) steady_.emplace(options, std::move(reopen));
  if (!options.mosaic.empty()) {
    mosaic_.onFinishedMap([this](const cv::Mat& image) { writeMap(image); });
  }
}

void BagViews::add(const sensor_msgs::ImageConstPtr& image, const HomographyStamped& message) {
  const std::optional<Eigen::Matrix3d> h = homographyOf(message);
  const std::int64_t stamp = stampOf(image->header.stamp);
  const std::int64_t reference = stampOf(message.reference_stamp);
  if (steady_) steady_->add(image, stamp, reference, h);
  if (options_.mosaic.empty()) return;
  const auto start = std::chrono::steady_clock::now();
  mosaic_.follow(stamp, reference, h);
  const Placement placement = mosaic_.place(stamp, colourImage(image));
  place_milliseconds_ += util::millisecondsSince(start);
  ++placed_;
  lost_ += placement == Placement::lost ? 1 : 0;
  ambiguous_ += mosaic_.isAmbiguous() ? 1 : 0;
  if (options_.mosaic_poses.empty()) return;
  poses_ += files::CsvRow()
                .add(textOf(image->header.stamp))
                .add(toString(placement))
                .add(mosaic_.maps())
                .add(mosaic_.pose().value_or(Eigen::Matrix3d::Zero()))
                .line();
}

void BagViews::writeMap(const cv::Mat& image) {
  const std::string path = mosaicOf(options_.mosaic, maps_.size() + 1);
  maps_.push_back(std::make_unique<files::OutputFile>(path, options_.force));
  files::writeImage(*maps_.back(), image);
}

void BagViews::close() {
  const cv::Mat map = options_.mosaic.empty() ? cv::Mat() : mosaic_.image();
  if (!map.empty()) writeMap(map);
  for (const auto& file : maps_) file->commit();
  if (steady_) steady_->close();
  if (!options_.mosaic_poses.empty()) {
    files::writeText(
        options_.mosaic_poses,
        std::string("stamp,placement,map,") + files::kHomographyColumns + '\n' + poses_,
        options_.force);
  }
}

std::string BagViews::report() const {
  std::string text;
  if (steady_) text += steady_->report();
  if (!options_.mosaic.empty() && maps_.empty()) {
    text += options_.mosaic + ": not written, since no image could be used\n";
  } else if (!options_.mosaic.empty()) {
    text += options_.mosaic;
    if (maps_.size() > 1) {
      text += " to " + mosaicOf(options_.mosaic, maps_.size()) + ": " +
              std::to_string(maps_.size()) + " maps, each in a file; the last";
    }
    text += util::format(
        ": %dx%d px; %zu frames, %zu of them lost, %zu keyframes, %.2f ms a frame%s\n",
        mosaic_.area().width, mosaic_.area().height, placed_, lost_, mosaic_.keyframes(),
        place_milliseconds_ / static_cast<double>(std::max<std::size_t>(placed_, 1)),
        mosaic_.full() ? "; full, some was left out" : "");
    if (ambiguous_ > 0) {
      text += options_.mosaic + ": the ground repeats: " + std::to_string(ambiguous_) +
              " frames after a gap fit in several places, and are lost\n";
    }
    if (mosaic_.hasParallax()) {
      text += util::format(
          "%s: the scene is no plane: points are about %.1f px off the map, and what is near is "
          "drawn several times\n",
          options_.mosaic.c_str(), mosaic_.planeDeviation());
    }
  }
  return text;
}

}  // namespace ktgp_orb
