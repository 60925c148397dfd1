#include "demo/signs.h"

#include <ktgp_orb/MatchStatus.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <opencv2/core/eigen.hpp>
#include <opencv2/imgproc.hpp>
#include <sstream>

#include "demo/canvas.h"
#include "demo/flight.h"
#include "demo/landscape.h"
#include "files/output_file.h"
#include "ros/pose_message.h"
#include "util/constants.h"

namespace ktgp_orb::demo {
namespace {

using RowMajor3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;

constexpr int kWidth = 200;  // px
constexpr int kHeight = 150;
constexpr double kSignWidth = kWidth * kMetre;  // m

/// Draws a letter on shapes in many colours. The signs must have no part in common: if only this
/// part is in view, one sign could be taken for another.
cv::Mat drawSign(const std::string& letter, std::uint64_t seed) {
  Dice dice(seed);
  const auto colour = [&dice] {
    return cv::Scalar(dice.between(20.F, 235.F), dice.between(20.F, 235.F),
                      dice.between(20.F, 235.F));
  };
  const cv::Size2f size(kWidth, kHeight);
  const Polygon all = rectangle({0.5F * kWidth, 0.5F * kHeight}, size, {1.F, 0.F});
  std::vector<Shape> shapes{{all, 0.F, colour()}};
  for (int i = 0; i < 70; ++i) {
    const cv::Point2f at = dice.inside(all);
    const float angle = dice.between(0.F, 3.F);
    const cv::Size2f extent(dice.between(8.F, 44.F), dice.between(8.F, 30.F));
    const bool disc = dice.chance(0.3F);
    const Polygon corners =
        disc ? Polygon{at} : rectangle(at, extent, {std::cos(angle), std::sin(angle)});
    shapes.push_back({corners, disc ? 0.4F * extent.height : 0.F, colour()});
  }
  cv::Mat picture(kHeight, kWidth, CV_8UC3);
  paint(shapes, picture);
  const cv::Size text = cv::getTextSize(letter, cv::FONT_HERSHEY_DUPLEX, 4.0, 14, nullptr);
  cv::putText(picture, letter, {(kWidth - text.width) / 2, (kHeight + text.height) / 2},
              cv::FONT_HERSHEY_DUPLEX, 4.0, colour(), 14, cv::LINE_AA);
  return picture;
}

/// The place below the camera `seconds` into the flight, `aside` px of the map to its right.
Eigen::Matrix3d place(double seconds, double aside, double degrees) {
  const Eigen::Vector3d middle(0.5 * (kImageWidth - 1), 0.5 * (kImageHeight - 1), 1.0);
  const Eigen::Vector2d at = (imageFromMap(seconds).inverse() * middle).hnormalized();
  const Eigen::Rotation2Dd turn(degrees * util::kPi / 180.0);
  Eigen::Matrix3d result = Eigen::Matrix3d::Identity();
  result.topLeftCorner<2, 2>() = turn.toRotationMatrix();
  result.topRightCorner<2, 1>() = at + Eigen::Vector2d(aside, 0.0) -
                                  turn * Eigen::Vector2d(0.5 * (kWidth - 1), 0.5 * (kHeight - 1));
  return result;
}

/// Pose of the middle of a sign in front of the camera.
Pose3 poseOf(const Eigen::Matrix3d& image_from_sign) {
  Eigen::Matrix3d sign_from_metres;
  sign_from_metres << 1.0 / kMetre, 0.0, 0.5 * (kWidth - 1), 0.0, 1.0 / kMetre, 0.5 * (kHeight - 1),
      0.0, 0.0, 1.0;
  Eigen::Matrix3d plane = intrinsics().inverse() * image_from_sign * sign_from_metres;
  plane /= plane.col(0).norm();
  Pose3 pose = Pose3::Identity();
  pose.linear() << plane.col(0), plane.col(1), plane.col(0).cross(plane.col(1));
  pose.translation() = plane.col(2);
  return pose;
}

TargetDetection truthOf(const Sign& sign, int number, const Eigen::Matrix3d& image_from_sign) {
  TargetDetection message;
  const double right = kWidth - 1;
  const double bottom = kHeight - 1;
  const Eigen::Vector3d corners[] = {
      {0.0, 0.0, 1.0}, {right, 0.0, 1.0}, {right, bottom, 1.0}, {0.0, bottom, 1.0}};
  for (std::size_t i = 0; i < 4; ++i) {
    const Eigen::Vector2d p = (image_from_sign * corners[i]).hnormalized();
    message.corners[2 * i] = p.x();
    message.corners[2 * i + 1] = p.y();
  }
  message.id = sign.id;
  message.instance = number;
  message.status = MatchStatus::STATUS_OK;
  message.image_width = kWidth;
  message.image_height = kHeight;
  Eigen::Map<RowMajor3>(message.homography.data()) = image_from_sign / image_from_sign(2, 2);
  message.width = kSignWidth;
  message.has_pose = 1;
  message.pose = toMessage(poseOf(image_from_sign), Covariance6::Zero());
  return message;
}

std::string listOf(const std::string& folder) {
  return folder + "/targets.yaml";
}

std::string pictureOf(const Sign& sign, const std::string& folder) {
  return folder + "/" + sign.id + ".png";
}

}  // namespace

std::vector<Sign> drawSigns() {
  return {{"north", drawSign("N", 11), {place(1.0, -140.0, 15.0), place(1.0, 140.0, -100.0)}},
          {"harbour", drawSign("H", 12), {place(3.5, 0.0, 60.0)}},
          {"market", drawSign("M", 13), {place(6.0, 0.0, 200.0)}}};
}

void paintOnto(const std::vector<Sign>& signs, cv::Mat& map) {
  for (const Sign& sign : signs) {
    for (const Eigen::Matrix3d& map_from_sign : sign.places) {
      cv::Mat warp;
      cv::eigen2cv(map_from_sign, warp);
      cv::warpPerspective(sign.picture, map, warp, map.size(), cv::INTER_LINEAR,
                          cv::BORDER_TRANSPARENT);
    }
  }
}

void writeSigns(const std::vector<Sign>& signs, const std::string& folder, bool force) {
  std::ostringstream list;
  for (const Sign& sign : signs) {
    files::writeImage(pictureOf(sign, folder), sign.picture, force);
    list << "- {id: " << sign.id << ", image: " << sign.id << ".png, width: " << kSignWidth
         << "}\n";
  }
  files::writeText(listOf(folder), list.str(), force);
}

std::vector<std::string> filesOf(const std::vector<Sign>& signs, const std::string& folder) {
  std::vector<std::string> files{listOf(folder)};
  for (const Sign& sign : signs) files.push_back(pictureOf(sign, folder));
  return files;
}

TargetDetections truthOf(const std::vector<Sign>& signs, const std_msgs::Header& image,
                         const Eigen::Matrix3d& image_from_map) {
  TargetDetections message;
  message.header = image;
  message.known = static_cast<std::uint32_t>(signs.size());
  for (const Sign& sign : signs) {
    int number = 0;
    for (const Eigen::Matrix3d& map_from_sign : sign.places) {
      message.detections.push_back(truthOf(sign, number++, image_from_map * map_from_sign));
    }
  }
  return message;
}

}  // namespace ktgp_orb::demo
