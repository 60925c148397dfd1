#include "two_view/solvers.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>

namespace ktgp_orb::two_view {
namespace {

double valueAt(const double* c, std::size_t degree, double z) {
  double value = c[degree];
  for (std::size_t i = degree; i-- > 0;) value = value * z + c[i];
  return value;
}

/// The root between `low` and `high`, where the polynomial has opposite signs. Makes Newton steps,
/// or bisection steps if a Newton step leaves the bracket, until a step is below `small`.
double rootBetween(const double* c, std::size_t degree, double low, double high, double at_low,
                   double small) {
  constexpr int kMaxSteps = 40;
  double z = 0.5 * (low + high);
  for (int step = 0; step < kMaxSteps; ++step) {
    double value = c[degree];
    double slope = 0.0;
    for (std::size_t i = degree; i-- > 0;) {
      slope = slope * z + value;
      value = value * z + c[i];
    }
    ((value > 0.0) == (at_low > 0.0) ? low : high) = z;
    double next = z - value / slope;
    if (!(next > low && next < high)) next = 0.5 * (low + high);
    const double move = std::abs(next - z);
    z = next;
    if (move < small) break;
  }
  return z;
}

/// Real roots of a polynomial in [-1, 1], ascending. Between two neighbouring roots of its
/// derivative, a polynomial has at most one root. We need the roots of the derivatives only as the
/// bounds of these intervals, so they need not be exact. After a Newton step below 1e-8, only
/// rounding errors remain.
template <std::size_t Degree>
std::size_t rootsInUnit(const std::array<double, Degree + 1>& coefficients,
                        std::array<double, Degree>& roots) {
  std::array<std::array<double, Degree + 1>, Degree> derivative;  // entry d has degree d + 1
  derivative[Degree - 1] = coefficients;
  for (std::size_t d = Degree - 1; d > 0; --d) {
    for (std::size_t i = 0; i <= d; ++i) {
      derivative[d - 1][i] = static_cast<double>(i + 1) * derivative[d][i + 1];
    }
  }
  std::size_t count = 0;
  for (std::size_t degree = 1; degree <= Degree; ++degree) {
    const double small = degree < Degree ? 1e-4 : 1e-8;
    const double* c = derivative[degree - 1].data();
    std::array<double, Degree> next{};
    std::size_t next_count = 0;
    double low = -1.0;
    double at_low = valueAt(c, degree, low);
    for (std::size_t i = 0; i <= count; ++i) {
      const double high = i < count ? roots[i] : 1.0;
      const double at_high = valueAt(c, degree, high);
      if ((at_low > 0.0) != (at_high > 0.0)) {
        next[next_count++] = rootBetween(c, degree, low, high, at_low, small);
      }
      low = high;
      at_low = at_high;
    }
    roots = next;
    count = next_count;
  }
  return count;
}

using Linear = Eigen::Array<double, 4, 1>;      // coefficients of x y z 1
using Quadratic = Eigen::Array<double, 10, 1>;  // coefficients of xx xy yy xz yz zz x y z 1
/// Coefficients of xxx yyy xxy xyy xxz xx yyz yy xyz xy, then xzz xz x yzz yz y zzz zz z 1
/// (Nister).
using Cubic = Eigen::Array<double, 20, 1>;

Quadratic product(const Linear& a, const Linear& b) {
  Quadratic q;
  q << a[0] * b[0], a[0] * b[1] + a[1] * b[0], a[1] * b[1], a[0] * b[2] + a[2] * b[0],
      a[1] * b[2] + a[2] * b[1], a[2] * b[2], a[0] * b[3] + a[3] * b[0], a[1] * b[3] + a[3] * b[1],
      a[2] * b[3] + a[3] * b[2], a[3] * b[3];
  return q;
}

void addProduct(const Quadratic& q, const Linear& l, Cubic& c) {
  c[0] += q[0] * l[0];
  c[1] += q[2] * l[1];
  c[2] += q[0] * l[1] + q[1] * l[0];
  c[3] += q[1] * l[1] + q[2] * l[0];
  c[4] += q[0] * l[2] + q[3] * l[0];
  c[5] += q[0] * l[3] + q[6] * l[0];
  c[6] += q[2] * l[2] + q[4] * l[1];
  c[7] += q[2] * l[3] + q[7] * l[1];
  c[8] += q[1] * l[2] + q[3] * l[1] + q[4] * l[0];
  c[9] += q[1] * l[3] + q[6] * l[1] + q[7] * l[0];
  c[10] += q[3] * l[2] + q[5] * l[0];
  c[11] += q[3] * l[3] + q[6] * l[2] + q[8] * l[0];
  c[12] += q[6] * l[3] + q[9] * l[0];
  c[13] += q[4] * l[2] + q[5] * l[1];
  c[14] += q[4] * l[3] + q[7] * l[2] + q[8] * l[1];
  c[15] += q[7] * l[3] + q[9] * l[1];
  c[16] += q[5] * l[2];
  c[17] += q[5] * l[3] + q[8] * l[2];
  c[18] += q[8] * l[3] + q[9] * l[2];
  c[19] += q[9] * l[3];
}

using Null = Eigen::Matrix<double, 9, 4>;  // the entries of E, row by row, are null * (x y z 1)^T

/// The ten cubic equations: det E = 0 and 2 E E^T E - tr(E E^T) E = 0.
void constraints(const Null& null, Eigen::Matrix<double, 10, 20>& equations) {
  Linear e[3][3];
  for (int i = 0; i < 9; ++i) e[i / 3][i % 3] = null.row(i).transpose().array();
  Quadratic square[3][3];  // E E^T - tr(E E^T)/2 I
  for (int i = 0; i < 3; ++i) {
    for (int j = i; j < 3; ++j) {
      square[i][j] =
          product(e[i][0], e[j][0]) + product(e[i][1], e[j][1]) + product(e[i][2], e[j][2]);
      square[j][i] = square[i][j];
    }
  }
  const Quadratic half_trace = 0.5 * (square[0][0] + square[1][1] + square[2][2]);
  for (int i = 0; i < 3; ++i) square[i][i] -= half_trace;
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) {
      Cubic row = Cubic::Zero();
      for (int k = 0; k < 3; ++k) addProduct(square[i][k], e[k][j], row);
      equations.row(3 * i + j) = row.matrix().transpose();
    }
  }
  Cubic determinant = Cubic::Zero();
  for (int i = 0; i < 3; ++i) {
    const int j = (i + 1) % 3;
    const int k = (i + 2) % 3;
    addProduct(product(e[1][j], e[2][k]) - product(e[1][k], e[2][j]), e[0][i], determinant);
  }
  equations.row(9) = determinant.matrix().transpose();
}

using Polynomial = std::array<double, 5>;  // degree up to 4, lowest first

/// A row of Nister's matrix B(z), for which B(z) (x y 1)^T = 0. It is the equation that starts with
/// xxz, yyz or xyz, minus z times the next equation, which starts with xx, yy or xy.
std::array<Polynomial, 3> rowOfB(const Eigen::Matrix<double, 6, 10>& m, Eigen::Index with_z) {
  const auto a = m.row(with_z);
  const auto b = m.row(with_z + 1);
  std::array<Polynomial, 3> row{};
  for (int axis = 0; axis < 2; ++axis) {
    const int at = 3 * axis;
    row[static_cast<std::size_t>(axis)] = {a[at + 2], a[at + 1] - b[at + 2], a[at] - b[at + 1],
                                           -b[at], 0.0};
  }
  row[2] = {a[9], a[8] - b[9], a[7] - b[8], a[6] - b[7], -b[6]};
  return row;
}

template <std::size_t N, std::size_t M>
std::array<double, N + M - 1> times(const std::array<double, N>& a,
                                    const std::array<double, M>& b) {
  std::array<double, N + M - 1> c{};
  for (std::size_t i = 0; i < N; ++i) {
    for (std::size_t j = 0; j < M; ++j) c[i + j] += a[i] * b[j];
  }
  return c;
}

using MatrixB = std::array<std::array<Polynomial, 3>, 3>;

std::array<double, 11> determinantOf(const MatrixB& b) {
  std::array<double, 13> sum{};
  for (std::size_t i = 0; i < 3; ++i) {
    const std::size_t j = (i + 1) % 3;
    const std::size_t k = (i + 2) % 3;
    const auto plus = times(b[1][j], b[2][k]);
    const auto minus = times(b[1][k], b[2][j]);
    std::array<double, 9> minor{};
    for (std::size_t n = 0; n < minor.size(); ++n) minor[n] = plus[n] - minus[n];
    const auto product = times(b[0][i], minor);
    for (std::size_t n = 0; n < sum.size(); ++n) sum[n] += product[n];
  }
  std::array<double, 11> determinant{};
  std::copy_n(sum.begin(), determinant.size(), determinant.begin());
  return determinant;
}

Eigen::Vector3d rowAt(const std::array<Polynomial, 3>& row, double z) {
  return {valueAt(row[0].data(), 3, z), valueAt(row[1].data(), 3, z), valueAt(row[2].data(), 4, z)};
}

/// The vector (x y 1), up to a factor, for which B(z) (x y 1)^T = 0: it is orthogonal to all three
/// rows.
Eigen::Vector3d nullOf(const MatrixB& b, double z) {
  const Eigen::Vector3d r0 = rowAt(b[0], z);
  const Eigen::Vector3d r1 = rowAt(b[1], z);
  const Eigen::Vector3d r2 = rowAt(b[2], z);
  Eigen::Vector3d best = r0.cross(r1);
  for (const Eigen::Vector3d& other :
       {Eigen::Vector3d(r1.cross(r2)), Eigen::Vector3d(r2.cross(r0))}) {
    if (other.squaredNorm() > best.squaredNorm()) best = other;
  }
  return best;
}

Eigen::Matrix3d matrixOf(const Eigen::Matrix<double, 9, 1>& rows) {
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(rows.data());
}

/// Basis of the null space of the epipolar constraints. Each column is a matrix, row by row.
template <int Pairs>
Eigen::Matrix<double, 9, 9 - Pairs> openSpace(const Eigen::Matrix<double, 3, Pairs>& reference,
                                              const Eigen::Matrix<double, 3, Pairs>& target) {
  Eigen::Matrix<double, 9, Pairs> equations;
  for (int i = 0; i < Pairs; ++i) {
    for (int row = 0; row < 3; ++row) {
      equations.template block<3, 1>(3 * row, i) = target(row, i) * reference.col(i);
    }
  }
  const Eigen::HouseholderQR<Eigen::Matrix<double, 9, Pairs>> qr(equations);
  Eigen::Matrix<double, 9, 9 - Pairs> basis;
  basis.setZero();
  basis.template bottomRows<9 - Pairs>().setIdentity();
  basis.applyOnTheLeft(qr.householderQ());
  return basis;
}

}  // namespace

template <std::size_t Degree>
std::size_t realRoots(const std::array<double, Degree + 1>& coefficients,
                      std::array<double, Degree>& roots) {
  std::size_t count = rootsInUnit<Degree>(coefficients, roots);
  // Roots with |z| > 1 are the inverses of the inner roots of the reversed polynomial.
  std::array<double, Degree + 1> reversed = coefficients;
  std::reverse(reversed.begin(), reversed.end());
  std::array<double, Degree> inverse{};
  const std::size_t outside = rootsInUnit<Degree>(reversed, inverse);
  for (std::size_t i = 0; i < outside && count < Degree; ++i) {
    if (std::abs(inverse[i]) < 1.0 && inverse[i] != 0.0) roots[count++] = 1.0 / inverse[i];
  }
  return count;
}

template std::size_t realRoots<3>(const std::array<double, 4>&, std::array<double, 3>&);

void solveFivePoints(const Eigen::Matrix<double, 3, 5>& reference,
                     const Eigen::Matrix<double, 3, 5>& target,
                     std::vector<Eigen::Matrix3d>& solutions) {
  solutions.clear();
  const Null null = openSpace<5>(reference, target);
  Eigen::Matrix<double, 10, 20> equations;
  constraints(null, equations);
  const Eigen::PartialPivLU<Eigen::Matrix<double, 10, 10>> lu(equations.leftCols<10>());
  const Eigen::Matrix<double, 10, 10> solved = lu.solve(equations.rightCols<10>());
  if (!solved.allFinite()) return;
  const Eigen::Matrix<double, 6, 10> last = solved.bottomRows<6>();
  const MatrixB b = {rowOfB(last, 0), rowOfB(last, 2), rowOfB(last, 4)};
  std::array<double, 10> roots;
  const std::size_t count = realRoots<10>(determinantOf(b), roots);
  for (std::size_t i = 0; i < count; ++i) {
    const double z = roots[i];
    const Eigen::Vector3d xy = nullOf(b, z);
    const Eigen::Vector4d weights(xy.x(), xy.y(), z * xy.z(), xy.z());
    Eigen::Matrix3d e = matrixOf(null * weights);
    e *= std::sqrt(2.0) / e.norm();
    if (e.allFinite()) solutions.push_back(e);
  }
}

void solveSevenPoints(const Eigen::Matrix<double, 3, 7>& reference,
                      const Eigen::Matrix<double, 3, 7>& target,
                      std::vector<Eigen::Matrix3d>& solutions) {
  solutions.clear();
  const Eigen::Matrix<double, 9, 2> null = openSpace<7>(reference, target);
  const Eigen::Matrix3d a = matrixOf(null.col(0));
  const Eigen::Matrix3d b = matrixOf(null.col(1));
  // Coefficients of det(a + z b): det a, det b, and between them the sums that `mixed` computes.
  const auto mixed = [](const Eigen::Matrix3d& once, const Eigen::Matrix3d& twice) {
    return once.col(0).dot(twice.col(1).cross(twice.col(2))) +
           once.col(1).dot(twice.col(2).cross(twice.col(0))) +
           once.col(2).dot(twice.col(0).cross(twice.col(1)));
  };
  std::array<double, 3> roots;
  const std::size_t count =
      realRoots<3>({a.determinant(), mixed(b, a), mixed(a, b), b.determinant()}, roots);
  for (std::size_t i = 0; i < count; ++i) {
    const Eigen::Matrix3d f = a + roots[i] * b;
    solutions.push_back(f / f.norm());
  }
}

// [t] is the matrix of the cross product with the unit vector t. With E = [t] R, the cross products
// of E's columns are the columns of t t^T R, and t t^T R - R = [t] E. So R = t t^T R - [t] E for t,
// and R = t t^T R + [t] E for -t.
std::array<RelativePose, 4> motionsOf(const Eigen::Matrix3d& e) {
  Eigen::Matrix3d products;
  products << e.col(1).cross(e.col(2)), e.col(2).cross(e.col(0)), e.col(0).cross(e.col(1));
  Eigen::Index longest = 0;
  products.colwise().squaredNorm().maxCoeff(&longest);
  const Eigen::Vector3d t = products.col(longest).normalized();
  const Eigen::Matrix3d te = crossed(t) * e;
  const Eigen::Matrix3d first = products - te;
  const Eigen::Matrix3d second = products + te;
  return {RelativePose{first, t}, RelativePose{first, -t}, RelativePose{second, t},
          RelativePose{second, -t}};
}

bool inFront(const RelativePose& motion, const Eigen::Vector3d& reference,
             const Eigen::Vector3d& target) {
  const Eigen::Vector3d ray = motion.rotation * reference;
  const double along = ray.dot(target);
  const double ray_t = ray.dot(motion.translation);
  const double target_t = target.dot(motion.translation);
  return along * target_t > ray_t * target.squaredNorm() &&
         ray.squaredNorm() * target_t > along * ray_t;
}

}  // namespace ktgp_orb::two_view
