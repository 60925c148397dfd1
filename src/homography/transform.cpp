#include "homography/transform.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <opencv2/imgproc.hpp>

#include "homography/part_in_view.h"

namespace ktgp_orb::homography {
namespace {

/// A projective basis of four points x1..x4. In homogeneous coordinates, x4 is the sum of (area_i /
/// whole) x_i for i = 1..3.
struct Basis {
  Eigen::Matrix3d rows;  // row i is orthogonal to the two points other than x_i: x_j × x_k
  // area_i: doubled signed area of the triangle x1 x2 x3 after x_i was replaced by x4.
  Eigen::Vector3d area;
  double whole = 0.0;  // doubled signed area of the triangle x1 x2 x3

  explicit Basis(const FourPoints& p) {
    const Eigen::Vector3d x1 = p[0].homogeneous();
    const Eigen::Vector3d x2 = p[1].homogeneous();
    const Eigen::Vector3d x3 = p[2].homogeneous();
    rows.row(0) = x2.cross(x3);
    rows.row(1) = x3.cross(x1);
    rows.row(2) = x1.cross(x2);
    area = rows * p[3].homogeneous();
    whole = rows.row(0).dot(x1);
  }

  bool flat(double min_area) const {
    return std::abs(whole) < min_area || area.cwiseAbs().minCoeff() < min_area;
  }
};

bool sameOrientation(const Basis& a, const Basis& b) {
  return a.whole * b.whole > 0.0 && (a.area.array() * b.area.array() > 0.0).all();
}

}  // namespace

// x_i: reference points; u_i: target points; r_i: rows of the reference basis; a_i, b_i: areas (see
// Basis) of reference and target. H = sum over i = 1..3 of (b_i / a_i) u_i r_i^T maps x_i to a
// multiple of u_i. It maps x4 to the sum of b_i u_i, which is u4 times the target's `whole`, so we
// divide H by `whole`.
bool solveFourPoints(const FourPoints& reference, const FourPoints& target,
                     double min_reference_area, double min_target_area,
                     Eigen::Matrix3d& homography) {
  const Basis from(reference);
  if (from.flat(min_reference_area)) return false;
  const Basis to(target);
  if (to.flat(min_target_area) || !sameOrientation(from, to)) return false;
  const Eigen::Vector3d ratio = to.area.cwiseQuotient(from.area) / to.whole;
  homography.setZero();
  for (int i = 0; i < 3; ++i) {
    const Eigen::Vector3d u = target[static_cast<std::size_t>(i)].homogeneous();
    homography.noalias() += (ratio[i] * u) * from.rows.row(i);
  }
  return true;
}

Eigen::Vector2d project(const Eigen::Matrix3d& homography, const Eigen::Vector2d& point) {
  return (homography * point.homogeneous()).hnormalized();
}

Eigen::Matrix<double, 2, 8> jacobianByEntries(const Eigen::Matrix3d& homography,
                                              const Eigen::Vector2d& point) {
  const Eigen::Vector3d p = homography * point.homogeneous();
  const Eigen::Vector2d q = p.hnormalized();
  const double x = point.x() / p.z();
  const double y = point.y() / p.z();
  Eigen::Matrix<double, 2, 8> jacobian;
  jacobian << x, y, 1.0 / p.z(), 0.0, 0.0, 0.0, -q.x() * x, -q.x() * y,  //
      0.0, 0.0, 0.0, x, y, 1.0 / p.z(), -q.y() * x, -q.y() * y;
  return jacobian;
}

Eigen::Matrix2d jacobianByPoint(const Eigen::Matrix3d& homography, const Eigen::Vector2d& point) {
  const Eigen::Vector3d p = homography * point.homogeneous();
  return (homography.topLeftCorner<2, 2>() - p.hnormalized() * homography.block<1, 2>(2, 0)) /
         p.z();
}

bool scaleLastToOne(Eigen::Matrix3d& homography) {
  constexpr double kNearZero = 1e-9;  // lower limit of |H(2,2)|, as a share of the norm of H
  const bool possible = std::abs(homography(2, 2)) > kNearZero * homography.norm();
  homography /= possible ? homography(2, 2) : homography.norm();
  return possible;
}

FourPoints imageCorners(const cv::Size& size, const std::vector<Eigen::Vector2d>& points) {
  Eigen::AlignedBox2d box;
  if (size.width > 0 && size.height > 0) {
    box.extend(Eigen::Vector2d::Zero());
    box.extend(Eigen::Vector2d(size.width - 1.0, size.height - 1.0));
  } else {
    for (const Eigen::Vector2d& p : points) box.extend(p);
  }
  using Box = Eigen::AlignedBox2d;
  return {box.corner(Box::BottomLeft), box.corner(Box::BottomRight), box.corner(Box::TopRight),
          box.corner(Box::TopLeft)};
}

bool keepsPlaneInView(const Eigen::Matrix3d& homography, const FourPoints& corners) {
  double nearest = homography.row(2).dot(corners[0].homogeneous());
  double farthest = nearest;
  for (const Eigen::Vector2d& corner : corners) {
    const double w = homography.row(2).dot(corner.homogeneous());
    nearest = std::min(nearest, w);
    farthest = std::max(farthest, w);
  }
  return homography.determinant() > 0.0 && nearest > kAtHorizon * farthest;
}

Eigen::Matrix3d facing(const Eigen::Matrix3d& homography) {
  const bool has_horizon = homography(2, 0) != 0.0 || homography(2, 1) != 0.0;
  const double side = has_horizon ? homography.determinant() : homography(2, 2);
  return side < 0.0 ? -homography : homography;
}

PartOfImage partInView(const Eigen::Matrix3d& facing, const FourPoints& corners, double least) {
  std::array<double, 4> depth{};
  for (std::size_t i = 0; i < 4; ++i) depth[i] = facing.row(2).dot(corners[i].homogeneous());
  const double limit = least * std::max(*std::max_element(depth.begin(), depth.end()), 0.0);
  PartOfImage part;
  for (std::size_t i = 0; i < 4; ++i) {
    const std::size_t next = (i + 1) % 4;
    if (depth[i] > limit) part.add(corners[i]);
    if ((depth[i] > limit) == (depth[next] > limit)) continue;
    const double share = (limit - depth[i]) / (depth[next] - depth[i]);
    part.add(corners[i] + share * (corners[next] - corners[i]));
  }
  return part;
}

Eigen::Matrix3d resizing(const cv::Size& from, const cv::Size& to) {
  const double x = static_cast<double>(to.width) / from.width;
  const double y = static_cast<double>(to.height) / from.height;
  Eigen::Matrix3d map = Eigen::Matrix3d::Identity();
  map(0, 0) = x;
  map(1, 1) = y;
  map(0, 2) = 0.5 * x - 0.5;
  map(1, 2) = 0.5 * y - 0.5;
  return map;
}

double overlap(const Eigen::Matrix3d& homography, const cv::Size& size) {
  const double w = size.width;
  const double h = size.height;
  const FourPoints corners{Eigen::Vector2d(0, 0), {w, 0}, {w, h}, {0, h}};
  const Eigen::Matrix3d view = facing(homography);
  std::array<cv::Point2f, 4> image;
  std::array<cv::Point2f, 8> warped;
  int seen = 0;
  for (std::size_t i = 0; i < 4; ++i) image[i] = cv::Point2d(corners[i].x(), corners[i].y());
  for (const Eigen::Vector2d& p : partInView(view, corners)) {
    const Eigen::Vector2d q = project(view, p);
    warped[static_cast<std::size_t>(seen++)] = cv::Point2d(q.x(), q.y());
  }
  if (seen < 3) return 0.0;
  const cv::Mat part(seen, 1, CV_32FC2, warped.data());
  return cv::intersectConvexConvex(image, part, cv::noArray()) / (w * h);
}

namespace {

using Matrix9x8 = Eigen::Matrix<double, 9, 8>;
using Matrix8 = Eigen::Matrix<double, 8, 8>;

/// Jacobian of the product A B with respect to A, entries row by row; the last entry of A is fixed.
Matrix9x8 derivativeByFirstFactor(const Eigen::Matrix3d& b) {
  Matrix9x8 j = Matrix9x8::Zero();
  for (Eigen::Index row = 0; row < 3; ++row) {
    const Eigen::Index columns = row < 2 ? 3 : 2;
    j.block(3 * row, 3 * row, 3, columns) = b.transpose().leftCols(columns);
  }
  return j;
}

/// Jacobian of the product A B with respect to B; the last entry of B is fixed.
Matrix9x8 derivativeBySecondFactor(const Eigen::Matrix3d& a) {
  Matrix9x8 j = Matrix9x8::Zero();
  for (int row = 0; row < 3; ++row) {
    for (int k = 0; k < 3; ++k) {
      for (int column = 0; column < 3; ++column) {
        if (3 * k + column < 8) j(3 * row + column, 3 * k + column) = a(row, k);
      }
    }
  }
  return j;
}

/// Jacobian of the first eight entries of C / C(2,2), from the Jacobian of C.
Matrix8 normalisedDerivative(const Matrix9x8& derivative, const Eigen::Matrix3d& c) {
  Matrix8 j;
  for (int i = 0; i < 8; ++i) {
    j.row(i) = (derivative.row(i) - c(i / 3, i % 3) / c(2, 2) * derivative.row(8)) / c(2, 2);
  }
  return j;
}

/// Returns an upper bound for the covariance of the sum of two errors with covariances A and B and
/// any correlation: (1 + 1/s) A + (1 + s) B is a bound for any s > 0. We choose s so that the bound
/// is exact if the two errors are proportional. Since the entries of H have different units, s is
/// computed from the share of each error in the variance of each entry.
Matrix8 sumOfShared(const Matrix8& a, const Matrix8& b) {
  double of_a = 0.0;
  double of_b = 0.0;
  for (int i = 0; i < 8; ++i) {
    const double both = a(i, i) + b(i, i);
    if (both == 0.0) continue;
    of_a += a(i, i) / both;
    of_b += b(i, i) / both;
  }
  if (of_a == 0.0 || of_b == 0.0) return a + b;
  const double s = std::sqrt(of_a / of_b);
  return (1.0 + 1.0 / s) * a + (1.0 + s) * b;
}

}  // namespace

CornerDeviation cornerDeviation(const Eigen::Matrix3d& homography,
                                const Eigen::Matrix<double, 8, 8>& covariance,
                                const FourPoints& corners) {
  const auto root = [](double variance) {
    return variance >= 0.0 ? std::sqrt(variance) : std::numeric_limits<double>::infinity();
  };
  CornerDeviation largest;
  for (const Eigen::Vector2d& corner : corners) {
    const Eigen::Matrix<double, 2, 8> by_entries = jacobianByEntries(homography, corner);
    const Eigen::Matrix2d spread = by_entries * covariance * by_entries.transpose();
    const Eigen::Matrix2d back = jacobianByPoint(homography, corner).inverse();
    largest.target = std::max(largest.target, root(spread.trace()));
    largest.reference =
        std::max(largest.reference, root((back * spread * back.transpose()).trace()));
  }
  return largest;
}

UncertainHomography chained(const UncertainHomography& second, const UncertainHomography& first) {
  const Eigen::Matrix3d product = second.homography * first.homography;
  const Matrix8 by_second =
      normalisedDerivative(derivativeByFirstFactor(first.homography), product);
  const Matrix8 by_first =
      normalisedDerivative(derivativeBySecondFactor(second.homography), product);
  UncertainHomography result;
  result.homography = product;
  if (std::abs(product(2, 2)) > 1e-12 * product.norm()) result.homography /= product(2, 2);
  const Matrix8 noise_of_second = second.covariance - second.shared_covariance;
  const Matrix8 noise_of_first = first.covariance - first.shared_covariance;
  result.shared_covariance =
      sumOfShared(by_second * second.shared_covariance * by_second.transpose(),
                  by_first * first.shared_covariance * by_first.transpose());
  result.covariance = by_second * noise_of_second * by_second.transpose() +
                      by_first * noise_of_first * by_first.transpose() + result.shared_covariance;
  result.plane_deviation = std::max(second.plane_deviation, first.plane_deviation);
  return result;
}

}  // namespace ktgp_orb::homography

namespace ktgp_orb {

double reprojectionError(const Eigen::Matrix3d& homography, const Eigen::Vector2d& reference,
                         const Eigen::Vector2d& target) {
  return ktgp_orb::homography::errorOf(homography, reference, target);
}

}  // namespace ktgp_orb
