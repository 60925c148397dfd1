#include "evaluation/truth_points.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <opencv2/core/eigen.hpp>
#include <sstream>

#include "files/input.h"
#include "homography/transform.h"

namespace ktgp_orb::evaluation {

namespace {

/// Reads the four numbers of a row. False if there are fewer or more, or something else.
bool readRow(const std::string& line, AnnotatedPoint& p) {
  std::istringstream row(line);
  row >> p.reference.x() >> p.reference.y() >> p.target.x() >> p.target.y();
  std::string more;
  return row && !(row >> more) && p.reference.allFinite() && p.target.allFinite();
}

// Points nearer than this cannot be told apart, px: annotations are hardly more accurate.
constexpr double kSamePlace = 1.0;

using Points = std::vector<Eigen::Vector2d>;

/// Returns true if all points but the one at `left_out` are within kSamePlace of one line.
bool areOnALineWithout(std::size_t left_out, const Points& points) {
  Points rest = points;
  rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(left_out));
  Eigen::Vector2d middle = Eigen::Vector2d::Zero();
  for (const Eigen::Vector2d& p : rest) middle += p / static_cast<double>(rest.size());
  Eigen::Matrix2d scatter = Eigen::Matrix2d::Zero();
  for (const Eigen::Vector2d& p : rest) scatter += (p - middle) * (p - middle).transpose();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> axes(scatter);
  const Eigen::Vector2d across = axes.eigenvectors().col(0);
  return std::all_of(rest.begin(), rest.end(), [&](const Eigen::Vector2d& p) {
    return std::abs(across.dot(p - middle)) < kSamePlace;
  });
}

/// Returns true if four of the points exist of which no three are on a line: unless all of them, or
/// all but one, are on a line.
bool determineAHomography(const Points& points) {
  Points apart;
  for (const Eigen::Vector2d& p : points) {
    const bool is_new = std::all_of(apart.begin(), apart.end(), [&](const Eigen::Vector2d& other) {
      return (p - other).norm() >= kSamePlace;
    });
    if (is_new) apart.push_back(p);
  }
  if (apart.size() < 4) return false;
  for (std::size_t i = 0; i < apart.size(); ++i) {
    if (areOnALineWithout(i, apart)) return false;
  }
  return true;
}

}  // namespace

std::vector<AnnotatedPoint> readPoints(const std::string& file) {
  constexpr std::size_t kFewest = 4;
  std::ifstream in(file);
  if (!in) throw files::FileError(file, "cannot be opened");
  std::vector<AnnotatedPoint> points;
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    if (line.find_first_not_of(" \t\r") == std::string::npos) continue;
    points.emplace_back();
    if (readRow(line, points.back())) continue;
    throw files::FileError(file, "line " + std::to_string(number) +
                                     " is no annotated point; expected four numbers `xA yA xB yB`");
  }
  if (points.size() < kFewest) {
    throw files::FileError(file,
                           "holds " + std::to_string(points.size()) +
                               " annotated points; expected at least four rows `xA yA xB yB`");
  }
  return points;
}

Eigen::Matrix3d homographyThrough(const std::vector<AnnotatedPoint>& points,
                                  const std::string& file) {
  Points in_reference, in_target;
  std::vector<cv::Point2d> from, to;
  for (const AnnotatedPoint& p : points) {
    in_reference.push_back(p.reference);
    in_target.push_back(p.target);
    from.emplace_back(p.reference.x(), p.reference.y());
    to.emplace_back(p.target.x(), p.target.y());
  }
  cv::Mat found;
  if (determineAHomography(in_reference) && determineAHomography(in_target)) {
    found = cv::findHomography(from, to);
  }
  if (found.empty()) {
    throw files::FileError(file,
                           "the annotated points determine no homography; expected four of which "
                           "no three are on a line");
  }
  Eigen::Matrix3d homography;
  cv::cv2eigen(found, homography);
  return homography;
}

double meanTransferError(const Eigen::Matrix3d& homography,
                         const std::vector<AnnotatedPoint>& points) {
  double sum = 0.0;
  for (const AnnotatedPoint& p : points)
    sum += reprojectionError(homography, p.reference, p.target);
  const double mean = sum / static_cast<double>(points.size());
  return std::isfinite(mean) ? mean : std::numeric_limits<double>::infinity();
}

bool isWithinCovariance(const UncertainHomography& estimate,
                        const std::vector<AnnotatedPoint>& points, double sigma) {
  // Chi-square with two degrees of freedom: exp(-x/2) is the probability of a value above x.
  const double limit = -2.0 * std::log(0.001 / static_cast<double>(points.size()));
  for (const AnnotatedPoint& point : points) {
    const auto jacobian = homography::jacobianByEntries(estimate.homography, point.reference);
    const Eigen::Matrix2d spread = jacobian * estimate.covariance * jacobian.transpose() +
                                   sigma * sigma * Eigen::Matrix2d::Identity();
    const Eigen::Vector2d error =
        homography::project(estimate.homography, point.reference) - point.target;
    if (!(error.dot(spread.inverse() * error) <= limit)) return false;
  }
  return true;
}

}  // namespace ktgp_orb::evaluation
