#pragma once

#include <gtest/gtest.h>

#include <Eigen/Core>

#include "estimation/robust_fit.h"

namespace ktgp_orb::test {

/// Compares the gradient that a problem writes with the differences of its cost under the same
/// weights; that checks residuals, Jacobian and retraction together. `weights`: after reset() and
/// setScale(). `tolerance`: share of the largest entry.
template <typename Problem>
void expectGradientByDifferences(Problem& problem, const typename Problem::State& state,
                                 estimation::RobustWeights& weights, double tolerance) {
  constexpr double kStep = 1e-6;
  estimation::NormalEquations sums, moved;
  problem.linearise(state, weights, sums);
  const Eigen::VectorXd gradient = sums.gradient;
  const double scale = gradient.cwiseAbs().maxCoeff();
  for (Eigen::Index i = 0; i < gradient.size(); ++i) {
    double cost[2];
    for (const int side : {0, 1}) {
      estimation::Step step = estimation::Step::Zero(gradient.size());
      step[i] = side == 0 ? -kStep : kStep;
      problem.linearise(state, weights, sums);
      problem.linearise(problem.moved(state, step), weights, moved);
      cost[side] = moved.former_cost;
    }
    EXPECT_NEAR((cost[1] - cost[0]) / (4.0 * kStep), gradient[i], tolerance * scale) << i;
  }
}

}  // namespace ktgp_orb::test
