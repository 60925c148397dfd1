#include "features/alignment/patch_aligner.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <optional>

#include "homography/transform.h"

namespace ktgp_orb::alignment {
namespace {

/// Maps positions on a pyramid level to level 0: x_level0 = factor * x_level + offset, along each
/// axis.
struct LevelMap {
  Eigen::Vector2d factor;
  Eigen::Vector2d offset;

  LevelMap(const std::vector<cv::Mat>& levels, std::size_t level)
      : factor(static_cast<double>(levels[0].cols) / levels[level].cols,
               static_cast<double>(levels[0].rows) / levels[level].rows),
        offset(0.5 * (factor - Eigen::Vector2d::Ones())) {}

  Eigen::Vector2d up(const Eigen::Vector2d& x) const { return factor.cwiseProduct(x) + offset; }
  Eigen::Vector2d down(const Eigen::Vector2d& x) const {
    return (x - offset).cwiseQuotient(factor);
  }
};

/// Index of the pyramid level that is smaller than level 0 by a factor of about `scale`; 0 if
/// `scale` is below 1.5.
std::size_t matchingLevel(const std::vector<cv::Mat>& levels, double scale) {
  constexpr double kLeast = 1.5;
  if (scale < kLeast) return 0;
  std::size_t best = 0;
  double least = std::log(scale);
  for (std::size_t i = 1; i < levels.size(); ++i) {
    if (levels[i].empty()) break;
    const double off =
        std::abs(std::log(scale * levels[i].cols / static_cast<double>(levels[0].cols)));
    if (off < least) {
      least = off;
      best = i;
    }
  }
  return best;
}

/// The patch is warped by an affine map, but H is not affine. Therefore the patch seems to be
/// shifted by the mean of H's second-order terms over the patch. Returns this shift, px of the
/// target. `back`: the affine warp, i.e. the inverse of H's Jacobian at the patch centre; `w`:
/// third homogeneous coordinate of the mapped centre; `side`: side lengths of the patch, px of the
/// target.
Eigen::Vector2d curvature(const Eigen::Matrix3d& h, double w, const Eigen::Matrix2d& back,
                          const Eigen::Vector2d& side) {
  const Eigen::Vector2d slope = back.transpose() * h.block<1, 2>(2, 0).transpose();
  return -slope.cwiseProduct(side.cwiseAbs2()) / (12.0 * w);
}

}  // namespace

bool PatchAligner::setImages(const std::vector<cv::Mat>& reference,
                             const std::vector<cv::Mat>& target) {
  reference_ = &reference;
  target_ = &target;
  const auto has_image = [](const std::vector<cv::Mat>& levels) {
    return !levels.empty() && !levels[0].empty();
  };
  return has_image(reference) && has_image(target);
}

AlignedPatch PatchAligner::align(const Eigen::Matrix3d& homography, const Eigen::Vector2d& point,
                                 double reach) {
  // A patch that is stretched or compressed by this factor or more, from the level of the reference
  // to the level of the target, is too distorted.
  constexpr double kMaxStretch = 4.0;
  AlignedPatch result;
  if (!((homography * point.homogeneous()).z() > 0.0)) return result;
  const Eigen::Matrix2d full = homography::jacobianByPoint(homography, point);
  const double determinant = full.determinant();
  result.outcome = PatchOutcome::distorted;
  if (!(determinant > 1e-4 && determinant < 1e4)) return result;
  const double scale = std::sqrt(determinant);
  const std::size_t target_level = matchingLevel(*target_, scale);
  const std::size_t reference_level = matchingLevel(*reference_, 1.0 / scale);
  const LevelMap in_target(*target_, target_level);
  const LevelMap in_reference(*reference_, reference_level);

  const Eigen::Vector2d centre = in_reference.down(point).array().floor() + 0.5;
  result.reference = in_reference.up(centre);
  const Eigen::Vector3d q = homography * result.reference.homogeneous();
  Eigen::Vector2d position = in_target.down(q.hnormalized());
  const Eigen::Matrix2d slope = homography::jacobianByPoint(homography, result.reference);
  const Eigen::Matrix2d local =
      in_target.factor.cwiseInverse().asDiagonal() * slope * in_reference.factor.asDiagonal();
  const Eigen::Matrix2d back = local.inverse();
  if (!(back.cwiseAbs().maxCoeff() < kMaxStretch && local.cwiseAbs().maxCoeff() < kMaxStretch)) {
    return result;
  }
  result.outcome = PatchOutcome::outside;
  if (!takePatch((*reference_)[reference_level], centre, back)) return result;
  result.outcome = settle((*target_)[target_level], reach, position, result);
  result.rounding2 *= in_target.factor.prod();
  result.target = in_target.up(position) -
                  curvature(homography, q.z(), slope.inverse(), kPatchSide * in_target.factor);
  return result;
}

bool PatchAligner::takePatch(const cv::Mat& level, const Eigen::Vector2d& centre,
                             const Eigen::Matrix2d& back) {
  constexpr double kUnit = 65536.0;
  const auto fixed = [](double x) { return static_cast<std::int32_t>(std::lrint(x * kUnit)); };
  // Distances, in samples, from the centre of the patch to its first sample and to the last sample
  // of a row in memory. The bounds below leave room for interpolation.
  constexpr double kFirst = 0.5 * (kWarpSide - 1);
  constexpr double kLast = kWarpPitch - 1 - kFirst;
  const Eigen::Vector2d spread = back.cwiseAbs() * Eigen::Vector2d(kLast, kFirst);
  const Eigen::Vector2d low = centre - spread;
  const Eigen::Vector2d high = centre + spread;
  if (!(low.x() >= 1.0 && low.y() >= 1.0 && high.x() < level.cols - 5.0 &&
        high.y() < level.rows - 3.0)) {
    return false;
  }
  const int x = static_cast<int>(centre.x());
  const int y = static_cast<int>(centre.y());
  const Eigen::Vector2d first =
      centre - Eigen::Vector2d(x, y) - back * Eigen::Vector2d(kFirst, kFirst);
  // The kernel truncates the positions of the samples to 1/256 px. We add half of this step, so
  // that they are rounded. Truncation would displace all patches by 1/512 px, in the same direction
  // in every frame.
  constexpr std::int32_t kHalfStep = 128;
  const AffineWalk walk{fixed(first.x()) + kHalfStep,
                        fixed(first.y()) + kHalfStep,
                        fixed(back(0, 0)),
                        fixed(back(1, 0)),
                        fixed(back(0, 1)),
                        fixed(back(1, 1))};
  kernels_.warp(level.ptr<std::uint8_t>(y) + x, static_cast<std::ptrdiff_t>(level.step), walk,
                patch_);
  kernels_.prepare(patch_, template_);
  return true;
}

namespace {

constexpr double kHalf = 0.5 * (kPatchSide - 1);

/// Sums of the products of the derivatives of a patch, without the part of the derivatives that
/// looks like a change of brightness (gain or bias).
struct Texture {
  double sx, sy;  // sx * value: part of dx that looks like a change of gain; sy: same for dy
  double xx, xy, yy;
  double determinant;

  /// Computes the sums; returns nothing if the patch has too little texture to be located.
  static std::optional<Texture> of(const PatchTemplate& patch) {
    // Minimum of the sum of the squared values t, in grey values², and of the sum of the squared
    // derivatives in the direction with the least texture, in grey values² per px².
    constexpr double kLeast = 500.0;
    if (!(patch.tt > kLeast)) return std::nullopt;
    Texture t{patch.tx / patch.tt, patch.ty / patch.tt, 0.0, 0.0, 0.0, 0.0};
    t.xx = patch.xx - t.sx * patch.tx;
    t.xy = patch.xy - t.sx * patch.ty;
    t.yy = patch.yy - t.sy * patch.ty;
    t.determinant = t.xx * t.yy - t.xy * t.xy;
    const double least =
        0.5 * (t.xx + t.yy) - std::sqrt(0.25 * (t.xx - t.yy) * (t.xx - t.yy) + t.xy * t.xy);
    if (!(least > kLeast)) return std::nullopt;
    return t;
  }
};

/// Upper left pixel of the search window for a patch with the upper left corner `corner`; empty if
/// the window leaves the image.
std::optional<Eigen::Vector2i> windowAround(const Eigen::Vector2d& corner, const cv::Mat& level) {
  constexpr double kFar = 1e6;     // beyond any image, but small enough for an int
  constexpr int kSmoothSlack = 4;  // columns that smoothing may read past the window
  // Number of whole px that the patch can move in each direction.
  constexpr int kSlack = (kWindowSide - kPatchSide) / 2 - 1;
  if (!(corner.array().abs() < kFar).all()) return std::nullopt;
  const int left = static_cast<int>(std::floor(corner.x())) - kSlack;
  const int top = static_cast<int>(std::floor(corner.y())) - kSlack;
  if (left < kPatchBorder || top < kPatchBorder ||
      left + kWindowSide + kPatchBorder + kSmoothSlack > level.cols ||
      top + kWindowSide + kPatchBorder > level.rows) {
    return std::nullopt;
  }
  return Eigen::Vector2i(left, top);
}

/// Returns how far the patch is from the position where it fits best, px, computed from the sums at
/// its present position. Returns nothing if the patch and the target do not correlate. Sets
/// `correlation` to the squared normalised cross-correlation.
std::optional<Eigen::Vector2d> offsetBy(const MatchSums& m, const Texture& t, double tt,
                                        double& correlation) {
  constexpr double kCount = kPatchSide * kPatchSide;
  const double gain = m.ti / tt;
  const double variance = m.ii - static_cast<double>(m.i) * m.i / kCount;
  if (!(gain > 0.0) || !(variance > 0.0)) return std::nullopt;
  // Limit the correlation to 1. Rounding of the single-precision sums may give more if the contrast
  // is very low.
  correlation = std::min(1.0, gain * m.ti / variance);
  const double bx = (m.xi - t.sx * m.ti) / gain;
  const double by = (m.yi - t.sy * m.ti) / gain;
  return Eigen::Vector2d((t.yy * bx - t.xy * by) / t.determinant,
                         (t.xx * by - t.xy * bx) / t.determinant);
}

}  // namespace

PatchOutcome PatchAligner::settle(const cv::Mat& level, double reach, Eigen::Vector2d& position,
                                  AlignedPatch& result) {
  constexpr int kMaxSteps = 8;
  constexpr double kSmallStep = 0.01;  // px
  constexpr double kLeastCorrelation = 0.5;
  const auto texture = Texture::of(template_);
  if (!texture) return PatchOutcome::textureless;
  const Eigen::Vector2d corner = position.array() - kHalf;
  const auto window = windowAround(corner, level);
  if (!window) return PatchOutcome::outside;
  kernels_.smooth(level.ptr<std::uint8_t>(window->y() - kPatchBorder) + window->x() - kPatchBorder,
                  static_cast<std::ptrdiff_t>(level.step), window_);
  const Eigen::Vector2d start = corner - window->cast<double>();
  Eigen::Vector2d at = start;
  Eigen::Vector2d last_move = Eigen::Vector2d::Zero();
  for (int step = 0; step < kMaxSteps; ++step) {
    const int x = static_cast<int>(at.x());
    const int y = static_cast<int>(at.y());
    const MatchSums sums =
        kernels_.compare(window_ + y * kWindowPitch + x, static_cast<float>(at.x() - x),
                         static_cast<float>(at.y() - y), template_);
    const auto offset = offsetBy(sums, *texture, template_.tt, result.correlation);
    if (!offset) return PatchOutcome::uncorrelated;
    // If the target is more blurred than the reference, each step covers only the same share of the
    // remaining distance. The steps then form a geometric series, and two of them determine its sum
    // (Aitken).
    Eigen::Vector2d move = *offset;
    const double ratio = step > 0 ? move.dot(last_move) / last_move.squaredNorm() : 0.0;
    last_move = move;
    if (step > 0 && std::abs(ratio) < 0.8) move /= 1.0 - ratio;
    at -= move;
    if (!((at - start).cwiseAbs().maxCoeff() <= reach)) return PatchOutcome::beyond_reach;
    if (!(move.squaredNorm() < kSmallStep * kSmallStep)) continue;
    if (result.correlation < kLeastCorrelation) return PatchOutcome::uncorrelated;
    constexpr double kRounding2 = 1.0 / 12.0;  // variance of the error of rounding to an integer
    result.rounding2 = 0.5 * kRounding2 * (texture->xx + texture->yy) / texture->determinant;
    position = window->cast<double>() + at + Eigen::Vector2d::Constant(kHalf);
    return PatchOutcome::aligned;
  }
  return PatchOutcome::unsettled;
}

}  // namespace ktgp_orb::alignment
