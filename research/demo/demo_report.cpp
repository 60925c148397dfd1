// Watches the demo: prints a status line while it runs, then writes a table and a picture. Also
// compares with the truth what ktgp_bag has found in the same flight, and in a recording of a
// camera that stands still.

#include <ktgp_orb/Correspondences.h>
#include <ktgp_orb/HomographyStamped.h>
#include <ktgp_orb/Match.h>
#include <ktgp_orb/MatchStatistics.h>
#include <ktgp_orb/MatchStatus.h>
#include <ros/ros.h>
#include <std_msgs/String.h>
#include <sys/stat.h>
#include <unistd.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <set>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "bag/reader.h"
#include "demo/effects.h"
#include "demo/flight.h"
#include "demo/motion_score.h"
#include "demo/stages.h"
#include "demo/table.h"
#include "ktgp_orb/metrics.h"
#include "ros/image_conversion.h"
#include "ros/message_conversion.h"

namespace ktgp_orb::demo {
namespace {

const cv::Size kImageSize(kImageWidth, kImageHeight);
const cv::Size kStillSize(768, 576);  // frame size of vtest.avi

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

/// RMS error of the frame's corners in the map, px of the map. `found`, `truth`: map -> frame.
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

/// Listens to the matcher during the flight. It only records: encoding pictures here would take the
/// processor from the matcher, and make this program miss messages.
class Report {
 public:
  Report(const std::string& bag, const std::string& folder)
      : truth_(bag), bag_(bag), folder_(folder), terminal_(isatty(STDOUT_FILENO) != 0) {
    ros::NodeHandle node;
    constexpr std::uint32_t kUnlimited = 0;
    statistics_ =
        node.subscribe("/camera/matcher/statistics", kUnlimited, &Report::onStatistics, this);
    matches_ = node.subscribe("/camera/matcher/match", kUnlimited, &Report::onMatch, this);
    motion_ = node.subscribe("/camera/ground_motion/odometry", kUnlimited, &Report::onMotion, this);
  }

  /// Runs until the results of the last frame have arrived, or nothing has arrived for a while.
  bool run() {
    constexpr double kStartTimeout = 60.0;  // s
    constexpr double kIdleTimeout = 5.0;
    ros::WallTime last_news = ros::WallTime::now();
    std::size_t seen = 0;
    while (ros::ok() && !isComplete()) {
      ros::spinOnce();
      ros::WallDuration(0.002).sleep();
      if (counted_.size() + results_.size() != seen) {
        seen = counted_.size() + results_.size();
        last_news = ros::WallTime::now();
      }
      const double idle = (ros::WallTime::now() - last_news).toSec();
      if (idle > (seen == 0 ? kStartTimeout : kIdleTimeout)) break;
    }
    if (terminal_) std::printf("\r\033[K");
    return !counted_.empty();
  }

  void write() const {
    ResultTable table;
    for (const auto& [stamp, statistics] : counted_) {
      const auto result = results_.find(stamp);
      table.add(statistics,
                result != results_.end() ? result->second : FrameResult{truth_.segment(stamp)});
    }
    const std::string text = table.text(truth_.frames()) + "\nmotion   " +
                             motionScore(truth_.motion(), odometries_) + "\n";
    std::fputs(text.c_str(), stdout);
    std::ofstream(folder_ + "/summary.txt") << text;
    KnownPair pair = graffiti();
    if (pair.reference.empty()) pair = pairOfTheFlight();
    if (pair.reference.empty()) return;
    cv::imwrite(folder_ + "/stages.png", drawStages(pair));
    std::printf("\npicture  %s/stages.png\n", folder_.c_str());
  }

 private:
  bool isComplete() const {
    const ros::Time last = truth_.lastStamp();
    return counted_.count(last) > 0 && results_.count(last) > 0;
  }

  void onStatistics(const MatchStatisticsConstPtr& statistics) {
    counted_[statistics->header.stamp] = *statistics;
  }

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
    results_[stamp] = result;
    showLine(statistics, result);
  }

  void showLine(const MatchStatistics& message, const FrameResult& result) const {
    constexpr std::size_t kEvery = 50;  // frames per line if it cannot be refreshed
    if (!terminal_ && results_.size() % kEvery != 0) return;
    std::printf("%s%s%s", terminal_ ? "\r\033[K" : "",
                frameLine(results_.size(), truth_.frames(), message, result).c_str(),
                terminal_ ? "" : "\n");
    std::fflush(stdout);
  }

  void onMotion(const nav_msgs::OdometryConstPtr& message) {
    odometries_[message->header.stamp] = *message;
  }

  /// Two frames of the flight, a second apart, for a system without photographs.
  KnownPair pairOfTheFlight() const {
    const auto images = openBag(bag_, {"/camera/image_raw"});
    const std::size_t first = images->total() / 4;
    const auto apart = static_cast<std::size_t>(kFrameRate);
    KnownPair pair;
    ros::Time stamp;
    for (std::size_t i = 0; i <= first + apart; ++i) {
      const auto recorded = images->next();
      if (!recorded || !recorded->image) return {};
      const ros::Time now = recorded->image->header.stamp;
      if (i == first) {
        pair.reference = colourImage(recorded->image).clone();
        stamp = now;
      } else if (i == first + apart) {
        pair.target = colourImage(recorded->image).clone();
        pair.truth = truth_.between(stamp, now);
      }
    }
    return pair;
  }

  Truth truth_;
  std::string bag_;
  std::string folder_;
  bool terminal_;
  std::map<ros::Time, MatchStatistics> counted_;
  std::map<ros::Time, FrameResult> results_;
  Odometries odometries_;
  ros::Subscriber statistics_;
  ros::Subscriber matches_;
  ros::Subscriber motion_;
};

std::vector<std::string> fieldsOf(const std::string& line) {
  std::vector<std::string> fields;
  std::istringstream stream(line);
  for (std::string field; std::getline(stream, field, ',');) fields.push_back(field);
  return fields;
}

/// A stamp as ktgp_bag writes it: seconds with nine digits behind the point.
ros::Time timeOf(const std::string& text) {
  const std::size_t point = text.find('.');
  return {static_cast<std::uint32_t>(std::stoul(text.substr(0, point))),
          static_cast<std::uint32_t>(std::stoul(text.substr(point + 1)))};
}

/// The homographies of a table that ktgp_bag has written (--csv or --mosaic_poses), by their
/// stamps; rows without a homography are left out.
std::map<ros::Time, Eigen::Matrix3d> readHomographies(const std::string& path) {
  std::ifstream file(path);
  std::string line;
  std::getline(file, line);
  const std::vector<std::string> names = fieldsOf(line);
  const auto column = [&](const char* name) {
    const auto found = std::find(names.begin(), names.end(), name);
    if (found == names.end()) throw std::runtime_error(path + ": has no column " + name);
    return static_cast<std::size_t>(found - names.begin());
  };
  const std::size_t stamp = column("stamp");
  const std::size_t first = column("h00");  // the other eight entries follow
  std::map<ros::Time, Eigen::Matrix3d> homographies;
  while (std::getline(file, line)) {
    const std::vector<std::string> fields = fieldsOf(line);
    Eigen::Matrix3d h = Eigen::Matrix3d::Zero();
    for (std::size_t i = 0; i < 9 && first + i < fields.size(); ++i) {
      h(static_cast<int>(i / 3), static_cast<int>(i % 3)) = std::atof(fields[first + i].c_str());
    }
    if (h(2, 2) != 0.0) homographies[timeOf(fields[stamp])] = h;
  }
  return homographies;
}

/// Prints how far the last frame is from its true place in the mosaic.
void scoreMosaic(const std::string& bag, const std::string& poses) {
  const auto places = readHomographies(poses);
  if (places.empty()) throw std::runtime_error(poses + ": no frame is in the mosaic");
  const Truth truth(bag);
  const ros::Time first = places.begin()->first;
  const ros::Time last = places.rbegin()->first;
  std::printf("mosaic   after %.1f s and %zu frames off by %.2f px (RMS)\n", (last - first).toSec(),
              places.size(), positionError(places.rbegin()->second, truth.between(first, last)));
}

/// The true homography of a camera that stands still is the identity.
void scoreStillCamera(const std::string& csv) {
  const auto homographies = readHomographies(csv);
  std::vector<double> errors;
  errors.reserve(homographies.size());
  for (const auto& [stamp, h] : homographies) {
    errors.push_back(metrics::cornerError(h, Eigen::Matrix3d::Identity(), kStillSize));
  }
  std::printf(
      "real     %zu homographies of a camera that stands still; corner error, median %.3f px\n",
      errors.size(), metrics::median(errors));
}

}  // namespace
}  // namespace ktgp_orb::demo

int main(int argc, char** argv) {
  ros::init(argc, argv, "demo_report");  // takes roslaunch's own arguments away
  const std::string mode = argc == 4 ? argv[1] : "";
  if (mode != "--live" && mode != "--files") {
    std::fprintf(stderr,
                 "usage: demo_report --live DEMO_BAG FOLDER   while the demo plays\n"
                 "       demo_report --files DEMO_BAG FOLDER  for mosaic.csv and real.csv there\n");
    return 2;
  }
  const std::string bag = argv[2];
  const std::string folder = argv[3];
  try {
    if (mode == "--files") {
      ktgp_orb::demo::scoreMosaic(bag, folder + "/mosaic.csv");
      const std::string real = folder + "/real.csv";
      if (std::filesystem::exists(real)) ktgp_orb::demo::scoreStillCamera(real);
      return 0;
    }
    mkdir(folder.c_str(), 0777);
    ktgp_orb::demo::Report report(bag, folder);
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
