#include "estimation/robust_fit.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <Eigen/LU>
#include <cmath>
#include <random>
#include <vector>

#include "estimation/sandwich.h"
#include "gradient_check.h"

namespace ktgp_orb::estimation {
namespace {

/// y = a exp(-b x).
struct Decay {
  using State = Eigen::Vector2d;
  static constexpr int kResiduals = 1, kParameters = 2;

  std::vector<double> x, y;

  static State moved(const State& state, const Step& step) { return state + step; }
  void evaluate(std::size_t i, const State& s, Eigen::Matrix<double, 1, 1>& residual,
                Eigen::Matrix<double, 1, 2>& jacobian) const {
    const double decay = std::exp(-s[1] * x[i]);
    residual[0] = s[0] * decay - y[i];
    jacobian << decay, -s[0] * x[i] * decay;
  }
  void linearise(const State& state, RobustWeights& weights, NormalEquations& sums) const {
    lineariseEach(*this, state, weights, sums);
  }
};

const Eigen::Vector2d kTruth(2.0, 1.5);

/// `deviation`: of the noise of each value; `shared`: of the error that the values of a cluster
/// have in common.
Decay drawDecay(int n, double deviation, double shared, int clusters, std::mt19937& random) {
  std::normal_distribution<double> normal;
  std::vector<double> error(static_cast<std::size_t>(clusters));
  for (double& e : error) e = shared * normal(random);
  Decay decay;
  for (int i = 0; i < n; ++i) {
    decay.x.push_back(2.0 * i / n);
    const auto cluster = static_cast<std::size_t>(i * clusters / n);
    decay.y.push_back(kTruth[0] * std::exp(-kTruth[1] * decay.x.back()) +
                      deviation * normal(random) + error[cluster]);
  }
  return decay;
}

struct Fitted {
  FitEnd end = FitEnd::undetermined;
  Eigen::Vector2d state = Eigen::Vector2d(1.0, 0.5);
  Eigen::Matrix2d covariance, by_cluster;
};

Fitted fitDecay(const Decay& decay, int clusters) {
  const std::size_t n = decay.x.size();
  Fitted fitted;
  RobustFit<const Decay> fit;
  fit.weights().reset(n, 1, 2);
  fit.weights().setScale(0.5);
  FitRules rules;
  rules.converged = 1e-7;
  rules.most_steps = 100;  // from 25 times the scale of the noise it takes about 60
  fitted.end = fit.minimise(decay, rules, fitted.state);
  const Information bread = breadOf(fit.sums());
  const Information meat = independentMeat(fit.sums(), fit.weights());
  fitted.covariance = sandwich(bread, meat);
  ClusteredMeat clustered;
  clustered.reset(2, static_cast<std::size_t>(clusters));
  for (std::size_t i = 0; i < n; ++i) {
    Eigen::Matrix<double, 1, 1> residual;
    Eigen::Matrix<double, 1, 2> jacobian;
    decay.evaluate(i, fitted.state, residual, jacobian);
    clustered.add(i * static_cast<std::size_t>(clusters) / n,
                  fit.weights().weight[i] * jacobian.transpose() * residual);
  }
  fitted.by_cluster = sandwich(bread, clustered.inflated(meat));
  return fitted;
}

/// Mean of the squared error of the state in units of its covariance, over the number of
/// parameters: 1 where the covariance is right.
struct Consistency {
  double independent = 0.0, by_cluster = 0.0;
};

Consistency consistencyOf(double deviation, double shared) {
  constexpr int kRuns = 400, kClusters = 40;
  std::mt19937 random(7);
  Consistency mean;
  for (int run = 0; run < kRuns; ++run) {
    const Fitted fitted = fitDecay(drawDecay(400, deviation, shared, kClusters, random), kClusters);
    const Eigen::Vector2d error = fitted.state - kTruth;
    mean.independent += error.dot(fitted.covariance.inverse() * error) / (2.0 * kRuns);
    mean.by_cluster += error.dot(fitted.by_cluster.inverse() * error) / (2.0 * kRuns);
  }
  return mean;
}

TEST(RobustFit, GradientIsThatOfTheCost) {
  std::mt19937 random(1);
  const Decay decay = drawDecay(50, 0.1, 0.0, 1, random);
  RobustWeights weights;
  weights.reset(50, 1, 2);
  weights.setScale(0.1);
  test::expectGradientByDifferences(decay, {1.7, 1.2}, weights, 1e-6);
}

TEST(RobustFit, OutliersMoveTheResultByLessThanTheNoise) {
  std::mt19937 random(2);
  std::uniform_real_distribution<double> anywhere(-3.0, 5.0);
  Decay decay = drawDecay(300, 0.02, 0.0, 1, random);
  for (std::size_t i = 0; i < decay.y.size(); i += 5) decay.y[i] = anywhere(random);
  const Fitted fitted = fitDecay(decay, 1);
  EXPECT_EQ(fitted.end, FitEnd::converged);
  // 240 good values with deviation 0.02 determine a to 0.004 and b to 0.005.
  EXPECT_NEAR(fitted.state[0], kTruth[0], 0.02);
  EXPECT_NEAR(fitted.state[1], kTruth[1], 0.025);
}

TEST(RobustFit, ExactDataGiveTheExactState) {
  std::mt19937 random(3);
  const Fitted fitted = fitDecay(drawDecay(60, 0.0, 0.0, 1, random), 1);
  EXPECT_LT((fitted.state - kTruth).norm(), 1e-7);
}

TEST(RobustFit, SameDataSameBits) {
  std::mt19937 random(4);
  const Decay decay = drawDecay(101, 0.1, 0.0, 1, random);
  EXPECT_EQ(fitDecay(decay, 1).state, fitDecay(decay, 1).state);
}

/// A parameter that no measurement shows.
struct Blind : Decay {
  void evaluate(std::size_t i, const State& s, Eigen::Matrix<double, 1, 1>& residual,
                Eigen::Matrix<double, 1, 2>& jacobian) const {
    Decay::evaluate(i, s, residual, jacobian);
    jacobian[1] = 0.0;
  }
  void linearise(const State& state, RobustWeights& weights, NormalEquations& sums) const {
    lineariseEach(*this, state, weights, sums);
  }
};

TEST(RobustFit, UndeterminedParameterHasInfiniteCovariance) {
  std::mt19937 random(5);
  const Blind blind{drawDecay(50, 0.1, 0.0, 1, random)};
  RobustWeights weights;
  weights.reset(50, 1, 2);
  weights.setScale(0.1);
  NormalEquations sums;
  blind.linearise(kTruth, weights, sums);
  EXPECT_TRUE(std::isinf(breadOf(sums)(1, 1)));
}

TEST(RobustFit, StateThatIsNotFiniteIsUndetermined) {
  std::mt19937 random(6);
  Decay decay = drawDecay(50, 0.1, 0.0, 1, random);
  decay.y[7] = std::nan("");
  EXPECT_EQ(fitDecay(decay, 1).end, FitEnd::undetermined);
}

TEST(Sandwich, IndependentErrorsAreConsistent) {
  // 400 runs determine the mean to 0.05.
  const Consistency mean = consistencyOf(0.05, 0.0);
  EXPECT_NEAR(mean.independent, 1.0, 0.2);
  EXPECT_NEAR(mean.by_cluster, 1.0, 0.25);
}

TEST(Sandwich, ClustersCoverErrorsThatTheirMeasurementsShare) {
  const Consistency mean = consistencyOf(0.05, 0.05);
  EXPECT_GT(mean.independent, 4.0);
  EXPECT_LT(mean.by_cluster, 1.5);
  EXPECT_GT(mean.by_cluster, 0.6);
}

}  // namespace
}  // namespace ktgp_orb::estimation
