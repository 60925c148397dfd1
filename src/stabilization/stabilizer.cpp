#include "ktgp_orb/stabilizer.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "homography/transform.h"
#include "util/options_check.h"

namespace ktgp_orb {
namespace {

using util::requireInRange;

// How far the smoothing looks before and after a frame, in standard deviations of the Gaussian
// weights. Frames farther away in time are not used.
constexpr double kReach = 3.0;
constexpr std::size_t kMaxPath = 600;  // frames
constexpr double kFadingTime = 0.5;    // s
// Shake that needs less than this share of the margin is removed completely. With a lag of 0, the
// smoothing needs more of the margin (see smoothed()), so the share is larger.
constexpr double kLinear = 0.5;
constexpr double kLinearAtOnce = 0.75;
// Weight of the assumption that the camera stands still, so that the slope of the fitted line is 0;
// used only with a lag of 0. It is small compared with the weight with which the earlier frames
// determine the slope: the sum of weight * (time - mean time)², which is 5 at 30 frames per second.
// So the assumption delays an even motion by only 0.01 s.
constexpr double kStillness = 0.1;

double seconds(std::int64_t nanoseconds) {
  return 1e-9 * static_cast<double>(nanoseconds);
}

/// Returns `share` itself up to `linear`. Maps larger values smoothly to values below 1.
double saturated(double share, double linear) {
  if (share <= linear) return share;
  return linear + (1.0 - linear) * std::tanh((share - linear) / (1.0 - linear));
}

/// Fits a line to weighted values over time and returns its value at time zero. If all values have
/// the same time, returns their mean instead.
class LineAtZero {
 public:
  /// `stillness`: weight of the assumption that the slope of the line is zero. It is added to the
  /// sum of weight * time², so it matters only if there are few values.
  explicit LineAtZero(double stillness) : square_(stillness) {}

  void add(double time, double weight, const std::array<Eigen::Vector2d, 4>& points) {
    weight_ += weight;
    time_ += weight * time;
    square_ += weight * time * time;
    for (std::size_t i = 0; i < points.size(); ++i) {
      sum_[i] += weight * points[i];
      product_[i] += weight * time * points[i];
    }
  }

  std::array<Eigen::Vector2d, 4> value() const {
    const double spread = weight_ * square_ - time_ * time_;
    const bool line = spread > 1e-9 * weight_ * square_;
    std::array<Eigen::Vector2d, 4> values;
    for (std::size_t i = 0; i < values.size(); ++i) {
      values[i] = line ? Eigen::Vector2d((square_ * sum_[i] - time_ * product_[i]) / spread)
                       : Eigen::Vector2d(sum_[i] / weight_);
    }
    return values;
  }

 private:
  double weight_ = 0.0;
  double time_ = 0.0;
  double square_;
  std::array<Eigen::Vector2d, 4> sum_{Eigen::Vector2d::Zero(), Eigen::Vector2d::Zero(),
                                      Eigen::Vector2d::Zero(), Eigen::Vector2d::Zero()};
  std::array<Eigen::Vector2d, 4> product_ = sum_;
};

/// Returns how far the correction moves the corners of the cropped picture outwards in the frame,
/// as a share of the margin: at 1, a corner reaches the frame's border.
double shareOfMargin(const Eigen::Matrix3d& correction,
                     const std::array<Eigen::Vector2d, 4>& corners, double crop) {
  const Eigen::Vector2d centre = 0.5 * (corners[0] + corners[2]);
  const Eigen::Vector2d half = (corners[2] - corners[0]).cwiseAbs() * 0.5;
  const Eigen::Matrix3d back = correction.inverse();
  double worst = 0.0;
  for (const Eigen::Vector2d& corner : corners) {
    const Eigen::Vector2d seen = centre + (1.0 - 2.0 * crop) * (corner - centre);
    const Eigen::Vector3d p = back * seen.homogeneous();
    if (p.z() * back.determinant() <= 0.0) return 1e9;
    const Eigen::Vector2d outward = (p.hnormalized() - centre).cwiseAbs() -  //
                                    (seen - centre).cwiseAbs();
    worst = std::max(worst, outward.cwiseQuotient(2.0 * crop * half).maxCoeff());
  }
  return worst;
}

}  // namespace

Stabilizer::Stabilizer(const StabilizerOptions& options) : path_(kMaxPath) {
  setOptions(options);
  reset();
}

void Stabilizer::setOptions(const StabilizerOptions& options) {
  requireInRange("strength", options.strength, 0.01, 10.0);
  requireInRange("lag", options.lag, 0, 60);
  requireInRange("max_crop", options.max_crop, 0.01, 0.4);
  options_ = options;
}

void Stabilizer::reset() {
  path_.clear();
  waiting_.clear();
  correction_.fill(Eigen::Vector2d::Zero());
  fading_ = correction_;
  size_ = {};
}

void Stabilizer::add(std::int64_t stamp, std::int64_t reference_stamp,
                     const std::optional<Eigen::Matrix3d>& homography, const cv::Size& size,
                     std::vector<SteadyFrame>& ready) {
  if (size != size_) {
    flush(ready);
    reset();
    size_ = size;
  }
  const bool known = path_.between(reference_stamp, reference_stamp).has_value();
  const bool connected = homography && FramePath::isUsable(*homography) && known;
  if (!connected) flush(ready);
  path_.add(stamp, reference_stamp, homography);
  if (!connected) {
    fading_ = correction_;
    fading_since_ = stamp;
  }
  waiting_.push_back({stamp, Eigen::Matrix3d::Identity(), !connected});
  while (waiting_.size() > static_cast<std::size_t>(options_.lag)) finishOldest(ready);
}

void Stabilizer::flush(std::vector<SteadyFrame>& ready) {
  while (!waiting_.empty()) finishOldest(ready);
}

/// Returns where a smoothly moving camera would see the corners of the frame with this `stamp`, in
/// px of this frame. `to_newest`: homography from this frame to the newest frame of the path.
Stabilizer::Corners Stabilizer::smoothed(std::int64_t stamp,
                                         const Eigen::Matrix3d& to_newest) const {
  const Corners corners = homography::imageCorners(size_, {});
  // With a lag of 0 there are no later frames, so the line is evaluated at its end, where the shake
  // of this frame itself would count most. So this frame gets a weight of almost 0, and the weights
  // of the other frames grow with their distance in time before they fall. Such weights need more
  // of the margin than a bell curve, but leave less jitter (doc/measurements/stabilization.md).
  const bool ends_here = options_.lag == 0;
  // At the start of a path, the slope of a line through the first few frames would be arbitrary.
  // kStillness prevents this.
  LineAtZero line(ends_here ? kStillness : 0.0);
  line.add(0.0, ends_here ? 1e-6 : 1.0, corners);
  for (const FramePath::Step& step : path_.steps()) {
    const double time = seconds(step.stamp - stamp) / options_.strength;
    if (step.stamp == stamp || std::abs(time) > kReach) continue;
    // Homography from the frame at `stamp` to the frame of `step`.
    const Eigen::Matrix3d there = step.to_newest.inverse() * to_newest;
    if (!homography::keepsPlaneInView(there / there(2, 2), corners)) continue;
    Corners seen;
    for (std::size_t i = 0; i < corners.size(); ++i) {
      seen[i] = (there * corners[i].homogeneous()).hnormalized();
    }
    line.add(time, std::exp(-0.5 * time * time) * (ends_here ? std::abs(time) : 1.0), seen);
  }
  return line.value();
}

/// Computes the homography that moves the corners of the frame by `wanted`, px. If this motion
/// needs a large share of the margin (see saturated()), makes it smaller, so that nothing beyond
/// the border of the frame is shown.
Eigen::Matrix3d Stabilizer::limited(const Corners& wanted) {
  const Corners corners = homography::imageCorners(size_, {});
  const double area = static_cast<double>(size_.area());
  double share = 1.0;
  Eigen::Matrix3d correction = Eigen::Matrix3d::Identity();
  for (int trial = 0; trial < 20; ++trial) {
    Corners moved;
    for (std::size_t i = 0; i < corners.size(); ++i) moved[i] = corners[i] + share * wanted[i];
    double used = 1e9;
    if (homography::solveFourPoints(corners, moved, 1e-3 * area, 1e-3 * area, correction)) {
      used = shareOfMargin(correction, corners, options_.max_crop);
    }
    const double allowed =
        trial == 0 ? saturated(used, options_.lag == 0 ? kLinearAtOnce : kLinear) : 1.0;
    if (used <= allowed) {
      for (std::size_t i = 0; i < corners.size(); ++i) correction_[i] = share * wanted[i];
      return correction;
    }
    share *= trial == 0 ? allowed / used : std::min(1.0 / used, 0.98);
  }
  correction_.fill(Eigen::Vector2d::Zero());
  return Eigen::Matrix3d::Identity();
}

void Stabilizer::finishOldest(std::vector<SteadyFrame>& ready) {
  SteadyFrame frame = waiting_.front();
  waiting_.pop_front();
  const Corners corners = homography::imageCorners(size_, {});
  const auto to_newest = path_.between(frame.stamp, path_.steps().back().stamp);
  Corners wanted = smoothed(frame.stamp, *to_newest);
  const double fade = std::exp(-std::max(0.0, seconds(frame.stamp - fading_since_)) / kFadingTime);
  for (std::size_t i = 0; i < corners.size(); ++i) wanted[i] += fade * fading_[i] - corners[i];

  const Eigen::Matrix3d correction = limited(wanted);
  const double zoom = 1.0 / (1.0 - 2.0 * options_.max_crop);
  const Eigen::Vector2d centre = 0.5 * (corners[0] + corners[2]);
  Eigen::Matrix3d crop;
  crop << zoom, 0.0, (1.0 - zoom) * centre.x(), 0.0, zoom, (1.0 - zoom) * centre.y(), 0.0, 0.0, 1.0;
  frame.warp = crop * correction;
  frame.warp /= frame.warp(2, 2);
  ready.push_back(frame);
}

double shakeOf(const std::vector<Eigen::Matrix3d>& steps, const cv::Size& size) {
  if (steps.size() < 2) return 0.0;
  const auto corners = homography::imageCorners(size, {});
  double sum = 0.0;
  for (std::size_t i = 1; i < steps.size(); ++i) {
    for (const Eigen::Vector2d& corner : corners) {
      const Eigen::Vector2d before = (steps[i - 1] * corner.homogeneous()).hnormalized();
      const Eigen::Vector2d now = (steps[i] * corner.homogeneous()).hnormalized();
      sum += (now - before).squaredNorm();
    }
  }
  return sum / static_cast<double>(corners.size() * (steps.size() - 1));
}

}  // namespace ktgp_orb
