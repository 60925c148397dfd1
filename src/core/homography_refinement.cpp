#include "homography_refinement.h"

#include <Eigen/Cholesky>
#include <algorithm>

namespace ktgp_orb {
namespace {

using Matrix8 = HomographyRefinement::Matrix8;
using Vector8 = HomographyRefinement::Vector8;
using Points = PointArrays<double>;
using Lanes = Eigen::Array<double, 2, 1>;

constexpr double kFreedom =
    4.0;  // of Student's t: heavy tails, yet near Gaussian for Gaussian data

Lanes load(const std::vector<double>& array, std::size_t first) {
  return Eigen::Map<const Lanes>(array.data() + first);
}

/// Where H puts two reference points, and how far off the target points that is.
struct Projection {
  Lanes x, y, z;  // reference point over the third coordinate w, and 1/w
  Lanes u, v;     // projected
  Lanes du, dv;   // projected - target

  Projection(const Points& points, const Eigen::Matrix3d& h, std::size_t first) {
    x = load(points.x, first);
    y = load(points.y, first);
    z = 1.0 / (h(2, 0) * x + h(2, 1) * y + h(2, 2));
    u = (h(0, 0) * x + h(0, 1) * y + h(0, 2)) * z;
    v = (h(1, 0) * x + h(1, 1) * y + h(1, 2)) * z;
    x *= z;
    y *= z;
    du = u - load(points.u, first);
    dv = v - load(points.v, first);
  }
};

/// The step d that solves (JtJ + damping diag(JtJ)) d = -Jt r; false where it is not determined.
bool solve(const Matrix8& jtj, const Vector8& jtr, double damping, Vector8& step) {
  Matrix8 damped = jtj;
  damped.diagonal() *= 1.0 + damping;
  const Eigen::LDLT<Matrix8> ldlt(damped);
  if (ldlt.info() != Eigen::Success || !ldlt.isPositive()) return false;
  step = -ldlt.solve(jtr);
  return step.allFinite();
}

Eigen::Matrix3d plus(const Eigen::Matrix3d& h, const Vector8& step) {
  Eigen::Matrix3d sum = h;
  for (int i = 0; i < 8; ++i) sum(i / 3, i % 3) += step[i];
  return sum;
}

}  // namespace

std::size_t HomographyRefinement::select(const Points& points, const Eigen::Matrix3d& homography,
                                         double limit) {
  const Eigen::Matrix3d& h = homography;
  const double limit2 = limit * limit;
  std::size_t n = 0;
  selected_.resize(points.size);
  for (std::size_t i = 0; i < points.size; i += 2) {
    const Projection p(points, h, i);
    const Lanes squared = p.du * p.du + p.dv * p.dv;
    for (std::size_t k = 0; k < std::min<std::size_t>(2, points.size - i); ++k) {
      const auto lane = static_cast<Eigen::Index>(k);
      if (!(squared[lane] < limit2) || !(p.z[lane] * h(2, 2) > 0.0)) continue;
      selected_.x[n] = points.x[i + k];
      selected_.y[n] = points.y[i + k];
      selected_.u[n] = points.u[i + k];
      selected_.v[n] = points.v[i + k];
      ++n;
    }
  }
  selected_.truncate(n);
  weight_.assign(selected_.paddedSize(), 0.0);
  std::fill_n(weight_.begin(), n, 1.0);
  squared_.resize(selected_.paddedSize());
  return n;
}

bool HomographyRefinement::gaussNewtonStep(Eigen::Matrix3d& homography) {
  homography /= homography(2, 2);
  const Normal normal = normalEquations(homography);
  Vector8 step;
  if (!solve(normal.jtj, normal.jtr, 0.0, step)) return false;
  homography = plus(homography, step);
  return true;
}

bool HomographyRefinement::levenbergMarquardt(double min_scale, Eigen::Matrix3d& homography) {
  constexpr int kMaxSteps = 30;
  constexpr double kConverged = 1e-9;  // of the entries of H, which are of the order of 1
  homography /= homography(2, 2);
  double damping = 1e-6;
  residuals(homography);
  scale2_ = 0.0;
  for (int i = 0; i < kMaxSteps; ++i) {
    const double cost = updateWeights(min_scale);
    const Normal normal = normalEquations(homography);
    Vector8 step;
    if (!solve(normal.jtj, normal.jtr, damping, step)) return false;
    const Eigen::Matrix3d candidate = plus(homography, step);
    residuals(candidate);
    double candidate_cost = 0.0;
    for (std::size_t k = 0; k < selected_.size; ++k) candidate_cost += weight_[k] * squared_[k];
    if (candidate_cost <= cost) {
      homography = candidate;
      damping *= 0.1;
    } else {
      residuals(homography);
      damping = std::max(damping, 1e-6) * 10.0;
    }
    if (step.cwiseAbs().maxCoeff() < kConverged) break;
  }
  return true;
}

void HomographyRefinement::residuals(const Eigen::Matrix3d& homography) {
  for (std::size_t i = 0; i < selected_.paddedSize(); i += 2) {
    const Projection p(selected_, homography, i);
    Eigen::Map<Lanes>(squared_.data() + i) = p.du * p.du + p.dv * p.dv;
  }
}

/// One step of expectation maximisation for the scale (Lange, Little & Taylor, JASA 1989), then
/// w = (nu + 2) / (nu + e²/scale²). Returns the weighted cost.
double HomographyRefinement::updateWeights(double min_scale) {
  const double n = static_cast<double>(selected_.size);
  if (scale2_ == 0.0) {
    for (std::size_t i = 0; i < selected_.size; ++i) scale2_ += squared_[i] / (2.0 * n);
  }
  for (int round = 0; round < 2; ++round) {
    scale2_ = std::max(scale2_, min_scale * min_scale);
    double cost = 0.0;
    for (std::size_t i = 0; i < selected_.size; ++i) {
      weight_[i] = (kFreedom + 2.0) / (kFreedom + squared_[i] / scale2_);
      cost += weight_[i] * squared_[i];
    }
    if (round == 1) return cost;
    scale2_ = cost / (2.0 * n);
  }
  return 0.0;
}

/// J's rows for one pair are [x y z 0 0 0 -u x -u y] and [0 0 0 x y z -v x -v y], x, y and z being
/// divided by w: so JtJ has 19 different sums, not 36.
HomographyRefinement::Normal HomographyRefinement::normalEquations(
    const Eigen::Matrix3d& homography) const {
  enum { xx, xy, xz, yy, yz, zz, uxx, uxy, uxz, uyy, uyz, vxx, vxy, vxz, vyy, vyz, qxx, qxy, qyy };
  Lanes s[19];
  Lanes g[8];
  for (Lanes& lanes : s) lanes.setZero();
  for (Lanes& lanes : g) lanes.setZero();
  for (std::size_t i = 0; i < selected_.paddedSize(); i += 2) {
    const Projection p(selected_, homography, i);
    const Lanes weight = load(weight_, i);
    const Lanes x = weight * p.x;
    const Lanes y = weight * p.y;
    const Lanes z = weight * p.z;
    const Lanes pxx = x * p.x;
    const Lanes pxy = x * p.y;
    const Lanes pxz = x * p.z;
    const Lanes pyy = y * p.y;
    const Lanes pyz = y * p.z;
    s[xx] += pxx;
    s[xy] += pxy;
    s[xz] += pxz;
    s[yy] += pyy;
    s[yz] += pyz;
    s[zz] += z * p.z;
    s[uxx] += p.u * pxx;
    s[uxy] += p.u * pxy;
    s[uxz] += p.u * pxz;
    s[uyy] += p.u * pyy;
    s[uyz] += p.u * pyz;
    s[vxx] += p.v * pxx;
    s[vxy] += p.v * pxy;
    s[vxz] += p.v * pxz;
    s[vyy] += p.v * pyy;
    s[vyz] += p.v * pyz;
    const Lanes q = p.u * p.u + p.v * p.v;
    s[qxx] += q * pxx;
    s[qxy] += q * pxy;
    s[qyy] += q * pyy;
    g[0] += x * p.du;
    g[1] += y * p.du;
    g[2] += z * p.du;
    g[3] += x * p.dv;
    g[4] += y * p.dv;
    g[5] += z * p.dv;
    const Lanes along = p.u * p.du + p.v * p.dv;
    g[6] -= x * along;
    g[7] -= y * along;
  }
  double t[19];
  for (int i = 0; i < 19; ++i) t[i] = s[i][0] + s[i][1];
  Normal normal;
  normal.jtj << t[xx], t[xy], t[xz], 0, 0, 0, -t[uxx], -t[uxy],              //
      t[xy], t[yy], t[yz], 0, 0, 0, -t[uxy], -t[uyy],                        //
      t[xz], t[yz], t[zz], 0, 0, 0, -t[uxz], -t[uyz],                        //
      0, 0, 0, t[xx], t[xy], t[xz], -t[vxx], -t[vxy],                        //
      0, 0, 0, t[xy], t[yy], t[yz], -t[vxy], -t[vyy],                        //
      0, 0, 0, t[xz], t[yz], t[zz], -t[vxz], -t[vyz],                        //
      -t[uxx], -t[uxy], -t[uxz], -t[vxx], -t[vxy], -t[vxz], t[qxx], t[qxy],  //
      -t[uxy], -t[uyy], -t[uyz], -t[vxy], -t[vyy], -t[vyz], t[qxy], t[qyy];
  for (int i = 0; i < 8; ++i) normal.jtr[i] = g[i][0] + g[i][1];
  return normal;
}

/// Huber, Robust Statistics (1981), section 7.6: the mean square of the weighted residuals over the
/// square of the mean derivative, times (JtJ)^-1 without weights. Eight of the 2n residuals went
/// into the eight entries.
Matrix8 HomographyRefinement::covariance(const Eigen::Matrix3d& homography) {
  double square = 0.0;
  double derivative = 0.0;
  for (std::size_t i = 0; i < selected_.size; ++i) {
    const double w = (kFreedom + 2.0) / (kFreedom + squared_[i] / scale2_);
    square += w * w * squared_[i];
    derivative += w * kFreedom / (kFreedom + squared_[i] / scale2_);
    weight_[i] = 1.0;
  }
  const double n = static_cast<double>(selected_.size);
  square /= std::max(2.0 * n - 8.0, 1.0);
  derivative /= n;
  const Matrix8 jtj = normalEquations(homography).jtj;
  return square / (derivative * derivative) * Eigen::LDLT<Matrix8>(jtj).solve(Matrix8::Identity());
}

}  // namespace ktgp_orb
