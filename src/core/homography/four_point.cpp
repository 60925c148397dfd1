#include "core/homography/four_point.h"

#include <Eigen/Geometry>
#include <cmath>

namespace ktgp_orb::homography {
namespace {

/// A projective basis: in homogeneous coordinates, x4 = sum of (area_i / whole) x_i for i = 1..3.
struct Basis {
  Eigen::Matrix3d rows;  // row i is orthogonal to the two points other than x_i: x_j × x_k
  Eigen::Vector3d area;  // doubled signed area of the triangle with x_i replaced by x4
  double whole = 0.0;    // doubled signed area of the triangle x1 x2 x3

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

// With r_i the rows and a_i, b_i the areas of reference and target, and u_i the target points,
// H = sum over i of (b_i / a_i) u_i r_i^T maps x_i to u_i and x4 to sum of b_i u_i = b_whole u4.
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

}  // namespace ktgp_orb::homography
