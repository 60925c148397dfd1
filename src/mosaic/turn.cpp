#include "mosaic/turn.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

#include "mosaic/surface.h"

namespace ktgp_orb::mosaic {
namespace {

constexpr double kDegree = M_PI / 180.0;
// A smaller turn needs no cylinder, and its homographies can hardly be distinguished from the
// homographies of a moving camera.
constexpr double kLeastTurn = 20.0;  // degrees
constexpr std::size_t kLeastPoses = 2;
constexpr std::size_t kLeastPosesForFocal = 4;
// The homographies determine the focal length if their deviation from a turn becomes more than
// kMuchWorse times as large when the focal length is made 5 % larger or smaller. Deviations below
// kNoise (px) count as kNoise.
constexpr double kFocalStep = 1.05;
constexpr double kMuchWorse = 2.0;
constexpr double kNoise = 0.1;
// Range of the focal lengths to try, as multiples of the image width. The horizontal field of view
// is 118 degrees at kShortest, and 6 degrees at kLongest.
constexpr double kShortest = 0.3;
constexpr double kLongest = 10.0;

Eigen::Matrix3d cameraOf(const cv::Size& size, double focal) {
  Eigen::Matrix3d camera = Eigen::Matrix3d::Identity();
  camera.diagonal().head<2>().setConstant(focal);
  camera.topRightCorner<2, 1>() << 0.5 * (size.width - 1), 0.5 * (size.height - 1);
  return camera;
}

/// Deviation of the homographies from a pure turn of a camera with the matrix `camera`, px (rms).
double offOf(const std::vector<Eigen::Matrix3d>& poses, const cv::Size& size,
             const Eigen::Matrix3d& camera) {
  double sum = 0.0;
  for (const Eigen::Matrix3d& pose : poses) {
    const double off = fitTurn(pose, camera, size).off;
    sum += off * off;
  }
  return std::sqrt(sum / static_cast<double>(poses.size()));
}

/// Computes the axis and the angle of the turn. All rotations begin at the first frame and have the
/// same axis. Larger rotations determine the axis better, so they have more weight. The axis points
/// down in the first frame, or to the right if the camera lies on its side.
void setRotations(const std::vector<Eigen::Matrix3d>& poses, const cv::Size& size, Turn& turn) {
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  turn.degrees = 0.0;
  for (const Eigen::Matrix3d& pose : poses) {
    const Eigen::Matrix3d rotation = fitTurn(pose, turn.camera, size).rotation;
    const Eigen::AngleAxisd about(rotation);
    sum += about.angle() * about.angle() * about.axis() * about.axis().transpose();
    const double cosine = std::clamp(rotation(2, 2), -1.0, 1.0);
    turn.degrees = std::max(turn.degrees, std::acos(cosine) / kDegree);
  }
  turn.axis = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(sum).eigenvectors().col(2);
  const bool is_upright = std::abs(turn.axis.y()) >= std::abs(turn.axis.x());
  if ((is_upright ? turn.axis.y() : turn.axis.x()) < 0.0) turn.axis = -turn.axis;
}

/// Sets `turn.camera` to the camera that fits the homographies best. Returns true if the
/// homographies determine its focal length.
bool estimate(const std::vector<Eigen::Matrix3d>& poses, const cv::Size& size, Turn& turn) {
  const auto off = [&](double focal) { return offOf(poses, size, cameraOf(size, focal)); };
  double best = kShortest * size.width;
  double least = off(best);
  for (double focal = best; focal <= kLongest * size.width; focal *= kFocalStep) {
    const double here = off(focal);
    if (here < least) std::tie(best, least) = std::pair(focal, here);
  }
  for (double step = std::sqrt(kFocalStep); step > 1.0005; step = std::sqrt(step)) {
    for (const double focal : {best / step, best * step}) {
      const double here = off(focal);
      if (here < least) std::tie(best, least) = std::pair(focal, here);
    }
  }
  turn.camera = cameraOf(size, best);
  turn.off = least;
  turn.is_estimated = true;
  const double elsewhere = std::min(off(best * kFocalStep), off(best / kFocalStep));
  return elsewhere > kMuchWorse * std::max(least, kNoise);
}

}  // namespace

// For frames that are 640 px wide, the limit is 2.6 px. It lies between two measured deviations. If
// the focal length is 3 % wrong, a pure turn by 20 degrees deviates by 2.3 px. In 200 flights over
// level and tilted planes, which moved the view by a quarter of the picture, the smallest deviation
// was 4.7 px, even with the best focal length.
double largestOff(const cv::Size& size) {
  constexpr double kShare = 0.004;
  return std::max(1.0, kShare * size.width);
}

Turn testTurn(const std::vector<Eigen::Matrix3d>& poses, const cv::Size& size,
              const std::optional<Eigen::Matrix3d>& camera) {
  Turn turn;
  if (poses.size() < kLeastPoses) return turn;
  const double limit = largestOff(size);
  bool is_told = poses.size() >= kLeastPosesForFocal && estimate(poses, size, turn);
  if (camera) {
    const double off = offOf(poses, size, *camera);
    // `camera` is wrong if another focal length fits the homographies twice as well.
    if (off <= (is_told ? kMuchWorse * std::max(turn.off, kNoise) : limit)) {
      turn.camera = *camera;
      turn.off = off;
      is_told = true;
      turn.is_estimated = false;
    }
  }
  if (!is_told && !turn.is_estimated) return turn;
  setRotations(poses, size, turn);
  if (turn.off > limit) {
    turn.verdict = Turn::Verdict::moves;
  } else if (is_told && turn.degrees >= kLeastTurn) {
    turn.verdict = Turn::Verdict::turns;
  }
  return turn;
}

}  // namespace ktgp_orb::mosaic
