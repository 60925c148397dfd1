// Watches the demo: a status line while it runs; then a table, two videos and two pictures.

#include <ktgp_orb/Correspondences.h>
#include <ktgp_orb/HomographyStamped.h>
#include <ktgp_orb/Match.h>
#include <ktgp_orb/MatchStatistics.h>
#include <ktgp_orb/MatchStatus.h>
#include <ktgp_orb/SaveMosaic.h>
#include <ros/ros.h>
#include <sensor_msgs/Image.h>
#include <std_msgs/String.h>
#include <sys/stat.h>
#include <unistd.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <set>
#include <stdexcept>
#include <string>

#include "bag/reader.h"
#include "demo/effects.h"
#include "demo/flight.h"
#include "demo/motion_score.h"
#include "demo/table.h"
#include "ktgp_orb/ktgp_matcher.h"
#include "ktgp_orb/metrics.h"
#include "ktgp_orb/overlay.h"
#include "ros/image_conversion.h"
#include "ros/message_conversion.h"
#include "tools/video_file.h"

namespace ktgp_orb::demo {
namespace {

const cv::Size kImageSize(kImageWidth, kImageHeight);

/// The ground truth, read from the bag.
class Truth {
 public:
  explicit Truth(const std::string& path) {
    const std::set<std::string> wanted{"/camera/ground_truth/homography",
                                       "/camera/ground_truth/odometry", "/camera/segment"};
    BagMessages messages(path);
    messages.select([&wanted](const bag::Topic& topic) { return wanted.count(topic.name) > 0; });
    while (const auto message = messages.next()) {
      if (const auto homography = message->as<HomographyStamped>()) {
        previous_stamp_[homography->header.stamp] = homography->reference_stamp;
        homography_[homography->header.stamp] = homographyOf(*homography).value();
      } else if (const auto odometry = message->as<nav_msgs::Odometry>()) {
        motion_[odometry->header.stamp] = *odometry;
      } else if (const auto segment = message->as<std_msgs::String>()) {
        segment_[message->received] = segment->data;
      }
    }
    if (segment_.empty()) throw std::runtime_error(path + " is not a demo bag: it has no truth");
  }

  std::size_t frames() const { return segment_.size(); }
  const Odometries& motion() const { return motion_; }
  ros::Time lastStamp() const { return segment_.rbegin()->first; }
  std::string segment(const ros::Time& stamp) const {
    const auto found = segment_.find(stamp);
    return found == segment_.end() ? "unknown" : found->second;
  }

  /// The true homography reference -> target, across dropped frames.
  Eigen::Matrix3d between(const ros::Time& reference, ros::Time target) const {
    Eigen::Matrix3d h = Eigen::Matrix3d::Identity();
    while (target > reference && homography_.count(target) > 0) {
      h = h * homography_.at(target);
      target = previous_stamp_.at(target);
    }
    return h / h(2, 2);
  }

 private:
  std::map<ros::Time, Eigen::Matrix3d> homography_;
  std::map<ros::Time, ros::Time> previous_stamp_;
  std::map<ros::Time, std::string> segment_;
  Odometries motion_;
};

/// Root mean square distance of the final matches from their true positions, px.
double reprojectionError(const Correspondences& matches, const Eigen::Matrix3d& truth) {
  double sum = 0.0;
  double count = 0.0;
  for (std::size_t i = 0; i < matches.level.size(); ++i) {
    if (matches.level[i] < Correspondences::LEVEL_KTGP) continue;
    const Eigen::Vector3d reference(matches.reference_x[i], matches.reference_y[i], 1.0);
    const Eigen::Vector2d target(matches.target_x[i], matches.target_y[i]);
    sum += (Eigen::Vector3d(truth * reference).hnormalized() - target).squaredNorm();
    ++count;
  }
  return count > 0.0 ? std::sqrt(sum / count) : 0.0;
}

/// Root mean square error of the frame's corners in the map, px of the map. `found`, `truth`: map
/// -> frame.
double positionError(const Eigen::Matrix3d& found, const Eigen::Matrix3d& truth) {
  double sum = 0.0;
  for (const double x : {0.0, kImageWidth - 1.0}) {
    for (const double y : {0.0, kImageHeight - 1.0}) {
      const Eigen::Vector3d corner(x, y, 1.0);
      sum += ((found.inverse() * corner).hnormalized() - (truth.inverse() * corner).hnormalized())
                 .squaredNorm();
    }
  }
  return std::sqrt(sum / 4.0);
}

class Report {
 public:
  Report(const std::string& bag, const std::string& folder)
      : truth_(bag),
        bag_(bag),
        folder_(folder),
        terminal_(isatty(STDOUT_FILENO) != 0),
        video_(folder + "/matches.mp4", kFrameRate, true),
        steady_video_(folder + "/stabilized.mp4", kFrameRate, true) {
    ros::NodeHandle node;
    matches_ = node.subscribe("/camera/matcher/match", 50, &Report::onMatch, this);
    overlays_ = node.subscribe("/camera/matcher/matches_image", 10, &Report::onOverlay, this);
    steady_ = node.subscribe("/camera/stabilizer/image", 10, &Report::onSteady, this);
    places_ = node.subscribe("/camera/mosaic/homography", 50, &Report::onPlace, this);
    motion_ = node.subscribe("/camera/ground_motion/odometry", 50, &Report::onMotion, this);
    save_ = node.serviceClient<SaveMosaic>("/camera/mosaic/save");
  }

  /// Until the last frame has arrived, or nothing has arrived for a while.
  bool run() {
    constexpr double kStartTimeout = 60.0;  // s
    constexpr double kIdleTimeout = 5.0;
    ros::WallTime last_news = ros::WallTime::now();
    std::size_t seen = 0;
    while (ros::ok() && !finished_) {
      ros::spinOnce();
      ros::WallDuration(0.002).sleep();
      if (table_.frames() != seen) {
        seen = table_.frames();
        last_news = ros::WallTime::now();
      }
      const double idle = (ros::WallTime::now() - last_news).toSec();
      if (idle > (seen == 0 ? kStartTimeout : kIdleTimeout)) break;
    }
    if (terminal_) std::printf("\r\033[K");
    return table_.frames() > 0;
  }

  void write() {
    const std::string text = table_.text(truth_.frames()) + "\nmotion   " +
                             motionScore(truth_.motion(), odometries_) + "\n";
    std::fputs(text.c_str(), stdout);
    std::ofstream(folder_ + "/summary.txt") << text;
    drawPicture();
    std::printf("\npicture  %s\n", picturePath().c_str());
    video_.close();
    steady_video_.close();
    std::printf("video    %s/matches.mp4\nvideo    %s/stabilized.mp4\n", folder_.c_str(),
                folder_.c_str());
    saveMosaic();
  }

 private:
  void saveMosaic() {
    SaveMosaic save;
    save.request.file = std::filesystem::absolute(folder_ + "/mosaic.png").string();
    if (!save_.call(save) || !save.response.success) {
      throw std::runtime_error("the mosaic is not saved: " + save.response.message);
    }
    std::printf("mosaic   %s", save.request.file.c_str());
    if (last_place_) {
      const Eigen::Matrix3d truth =
          truth_.between(last_place_->reference_stamp, last_place_->header.stamp);
      std::printf(", after %.1f s off by %.2f px (RMS)",
                  (last_place_->header.stamp - last_place_->reference_stamp).toSec(),
                  positionError(homographyOf(*last_place_).value(), truth));
    }
    std::printf("\n");
  }

  std::string picturePath() const { return folder_ + "/stages.png"; }

  void onMatch(const MatchConstPtr& match) {
    const MatchStatistics& statistics = match->statistics;
    const ros::Time& stamp = match->header.stamp;
    FrameResult result;
    result.segment = truth_.segment(stamp);
    if (statistics.status == MatchStatus::STATUS_OK) {
      const Eigen::Matrix3d truth = truth_.between(statistics.reference_stamp, stamp);
      result.error =
          metrics::cornerError(homographyOf(match->homography).value(), truth, kImageSize);
      result.reprojection_error = reprojectionError(match->correspondences, truth);
    }
    table_.add(statistics, result);
    showLine(statistics, result);
    finished_ = stamp >= truth_.lastStamp();
  }

  void showLine(const MatchStatistics& message, const FrameResult& result) {
    constexpr std::size_t kEvery = 50;  // frames per line if it cannot be refreshed
    if (!terminal_ && table_.frames() % kEvery != 0) return;
    std::printf("%s%s%s", terminal_ ? "\r\033[K" : "",
                frameLine(table_.frames(), truth_.frames(), message, result).c_str(),
                terminal_ ? "" : "\n");
    std::fflush(stdout);
  }

  void onOverlay(const sensor_msgs::ImageConstPtr& message) {
    const cv::Mat picture(static_cast<int>(message->height), static_cast<int>(message->width),
                          CV_8UC3, const_cast<std::uint8_t*>(message->data.data()), message->step);
    video_.write(picture);
  }

  void onSteady(const sensor_msgs::ImageConstPtr& message) {
    steady_video_.write(cv::Mat(static_cast<int>(message->height), static_cast<int>(message->width),
                                CV_8UC3, const_cast<std::uint8_t*>(message->data.data()),
                                message->step));
  }

  void onMotion(const nav_msgs::OdometryConstPtr& message) {
    odometries_[message->header.stamp] = *message;
  }

  void onPlace(const HomographyStampedConstPtr& message) {
    if (message->status == MatchStatus::STATUS_OK) last_place_ = message;
  }

  /// The stages for one pair of frames of the bag, matched here with the default options.
  void drawPicture() const {
    const auto images = openBag(bag_, {"/camera/image_raw"});
    const std::size_t wanted = images->total() / 4;
    OrbExtractor extractor;
    KtgpMatcher matcher;
    FramePtr frames[2];
    for (std::size_t i = 0; i < wanted; ++i) images->next();
    for (FramePtr& frame : frames) {
      const auto recorded = images->next();
      if (!recorded) return;
      frame = makeFrame(recorded->image, extractor);
    }
    if (!frames[1]) return;
    MatchResult result;
    cv::Mat canvas;
    matcher.match(frames[0]->features, frames[1]->features, result);
    drawStages({frames[0]->image, frames[0]->features}, {frames[1]->image, frames[1]->features},
               result, canvas);
    cv::imwrite(picturePath(), canvas);
  }

  Truth truth_;
  std::string bag_;
  std::string folder_;
  bool terminal_;
  bool finished_ = false;
  ResultTable table_;
  tools::VideoFile video_;
  tools::VideoFile steady_video_;
  HomographyStampedConstPtr last_place_;
  ros::Subscriber matches_;
  ros::Subscriber overlays_;
  ros::Subscriber steady_;
  Odometries odometries_;
  ros::Subscriber motion_;
  ros::Subscriber places_;
  ros::ServiceClient save_;
};

}  // namespace
}  // namespace ktgp_orb::demo

int main(int argc, char** argv) {
  ros::init(argc, argv, "demo_report");
  if (argc != 3) {
    std::fprintf(stderr, "usage: demo_report DEMO_BAG OUTPUT_FOLDER\n");
    return 2;
  }
  try {
    mkdir(argv[2], 0777);
    ktgp_orb::demo::Report report(argv[1], argv[2]);
    if (!report.run()) {
      std::fprintf(stderr, "demo_report: the matcher published nothing\n");
      return 1;
    }
    report.write();
  } catch (const std::exception& error) {
    std::fprintf(stderr, "demo_report: %s\n", error.what());
    return 1;
  }
  return 0;
}
