#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <vector>

#include "ktgp_orb/two_view.h"
#include "util/geometry.h"

namespace ktgp_orb::two_view {

using util::crossed;

/// Real roots of the sum of coefficients[i] z^i: first the roots with |z| <= 1, ascending, then the
/// others. Returns their number, at most Degree.
template <std::size_t Degree>
std::size_t realRoots(const std::array<double, Degree + 1>& coefficients,
                      std::array<double, Degree>& roots);

/// Computes the essential matrices E, at most ten, with q'^T E q = 0 for five pairs, by Nister's
/// solver (PAMI 2004). The columns of `reference` and `target` are the rays q and q' of the pairs:
/// K^-1 (x y 1)^T for a point (x, y) in px. Each solution has Frobenius norm sqrt(2).
void solveFivePoints(const Eigen::Matrix<double, 3, 5>& reference,
                     const Eigen::Matrix<double, 3, 5>& target,
                     std::vector<Eigen::Matrix3d>& solutions);

/// Computes the fundamental matrices, at most three, that agree with seven pairs (Hartley &
/// Zisserman, 2003, section 11.1.2). Each has norm 1. The coordinates should be of the order of 1.
void solveSevenPoints(const Eigen::Matrix<double, 3, 7>& reference,
                      const Eigen::Matrix<double, 3, 7>& target,
                      std::vector<Eigen::Matrix3d>& solutions);

/// The four motions of an essential matrix of norm sqrt(2), in closed form (Horn, 1990).
std::array<RelativePose, 4> motionsOf(const Eigen::Matrix3d& essential);

/// Returns true if the scene point nearest to the two rays of a pair is in front of both cameras.
bool inFront(const RelativePose& motion, const Eigen::Vector3d& reference,
             const Eigen::Vector3d& target);

}  // namespace ktgp_orb::two_view
