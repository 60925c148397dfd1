#include "growth/reference_frames.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

#include "homography/transform.h"

namespace ktgp_orb::growth {
namespace {

/// Ratio of the axes of the ellipse to which `linear` maps a circle.
double squeezeOf(const Eigen::Matrix2d& linear) {
  const double det = std::abs(linear.determinant());
  // This is (a² + b²) / 2 for an ellipse with the axes a and b; det = a b.
  const double half = 0.5 * linear.squaredNorm();
  if (!(det > 0.0)) return std::numeric_limits<double>::infinity();
  return (half + std::sqrt(std::max(half * half - det * det, 0.0))) / det;
}

}  // namespace

void ReferenceFrames::set(const Features& reference, const ReferenceViews* views) {
  views_.clear();
  frames_.clear();
  bits_.clear();
  view_of_.clear();
  std::size_t count = reference.size();
  if (views != nullptr) {
    for (const ReferenceView& view : *views) count += view.features.size();
  }
  frames_.reserve(count);
  bits_.reserve(count);
  add(reference, Eigen::Matrix<double, 2, 3>::Identity());
  if (views == nullptr) return;
  for (const ReferenceView& view : *views) add(view.features, view.to_view);
}

void ReferenceFrames::add(const Features& features, const Eigen::Matrix<double, 2, 3>& to_view) {
  const Eigen::Matrix2d from_view = to_view.leftCols<2>().inverse();
  const Eigen::Matrix2f jacobian = from_view.cast<float>();
  const auto log_scale = static_cast<float>(0.5 * std::log(std::abs(from_view.determinant())));
  const std::size_t begin = frames_.size();
  for (std::size_t i = 0; i < features.size(); ++i) {
    const LocalFrame frame = frameOf(features.keypoints[i]);
    const Eigen::Vector2d place = from_view * (Eigen::Vector2d(frame.x, frame.y) - to_view.col(2));
    frames_.push_back(mapped(frame, place.cast<float>(), jacobian, log_scale));
    bits_.push_back(bitsOf(features, i));
  }
  view_of_.resize(frames_.size(), static_cast<std::uint16_t>(views_.size()));
  views_.push_back({begin, frames_.size(), from_view, to_view.leftCols<2>().cast<float>()});
}

bool ReferenceFrames::chooseViews(const Eigen::Matrix2d& jacobian) {
  constexpr double kSqueeze = 1.8;     // views with at most this tilt to the target are used
  constexpr double kMaxSqueeze = 4.0;  // largest tilt between the target and the most similar view
  constexpr double kMaxArea = 64.0;    // largest change of area: a factor of eight in length
  const double area = jacobian.determinant();
  if (!(area > 1.0 / kMaxArea && area < kMaxArea)) return false;
  squeeze_.clear();
  for (const View& view : views_) squeeze_.push_back(squeezeOf(jacobian * view.from_view));
  const double least = *std::min_element(squeeze_.begin(), squeeze_.end());
  if (!(least < kMaxSqueeze)) return false;
  const double limit = std::max(kSqueeze, least);
  chosen_.clear();
  for (const double squeeze : squeeze_) chosen_.push_back(squeeze <= limit ? 1 : 0);
  return true;
}

bool ReferenceFrames::predict(const Eigen::Matrix3d& map, const Eigen::Vector2d& centre,
                              double reach, const cv::Size& target,
                              std::vector<Prediction>& predictions) {
  predictions.clear();
  if (!chooseViews(homography::jacobianByPoint(map, centre))) return false;
  const float right = static_cast<float>(target.width) + kMargin;
  const float bottom = static_cast<float>(target.height) + kMargin;
  const Eigen::Matrix3f h = map.cast<float>();
  // The map scales areas at x by det(H) / w³, where w is the third coordinate of H x.
  const auto log_scale = static_cast<float>(0.5 * std::log(map.determinant()));
  const bool affine = h(2, 0) == 0.F && h(2, 1) == 0.F && h(2, 2) == 1.F;
  const Eigen::Vector2f middle = centre.cast<float>();
  const auto squared_reach = static_cast<float>(std::min(reach * reach, 1e30));
  for (std::size_t v = 0; v < views_.size(); ++v) {
    if (chosen_[v] == 0) continue;
    for (std::size_t i = views_[v].begin; i < views_[v].end; ++i) {
      const LocalFrame& frame = frames_[i];
      const Eigen::Vector2f x(frame.x, frame.y);
      if (!((x - middle).squaredNorm() <= squared_reach)) continue;
      const float w = h.row(2).dot(x.homogeneous());
      if (!(w > 0.F)) continue;
      const Eigen::Vector2f u = (h.topRows<2>() * x.homogeneous()) / w;
      if (!(u.x() > -kMargin && u.y() > -kMargin && u.x() < right && u.y() < bottom)) continue;
      const Eigen::Matrix2f jacobian = (h.topLeftCorner<2, 2>() - u * h.block<1, 2>(2, 0)) / w;
      const float here = affine ? log_scale : log_scale - 1.5F * std::log(w);
      predictions.push_back({mapped(frame, u, jacobian, here), static_cast<std::int32_t>(i)});
    }
  }
  return true;
}

}  // namespace ktgp_orb::growth
