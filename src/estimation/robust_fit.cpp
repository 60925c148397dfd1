#include "estimation/robust_fit.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "estimation/sandwich.h"

namespace ktgp_orb::estimation {

bool findStep(const NormalEquations& sums, double damping, const FitRules& rules, Step& step) {
  Information damped = sums.squares;
  damped.diagonal() *= 1.0 + damping;
  const Eigen::LDLT<Information> ldlt(damped);
  if (ldlt.info() != Eigen::Success || !ldlt.isPositive()) return false;
  const double most = rules.lengthening;
  const double longer = sums.weight < most * sums.derivative ? sums.weight / sums.derivative : most;
  step = ldlt.solve(sums.gradient) * -longer;
  return step.allFinite() && step.cwiseAbs().maxCoeff() < rules.longest;
}

void setLeastSquares(const util::SmallRef& residual, const util::SmallRef& jacobian,
                     NormalEquations& sums) {
  sums.squares = util::times(jacobian.transpose(), jacobian);
  sums.gradient = util::times(jacobian.transpose(), residual);
  sums.weight = sums.derivative = 1.0;
  sums.square = sums.cost = sums.former_cost = residual.squaredNorm();
}

Information inverseOf(const util::SmallRef& squares) {
  // A pivot that is smaller than this share of the largest pivot is only a rounding error.
  constexpr double kSingular = 1e-14;
  const Eigen::Index p = squares.rows();
  const Eigen::LDLT<Information> ldlt(squares);
  const auto pivots = ldlt.vectorD();
  if (ldlt.info() != Eigen::Success || !(pivots.minCoeff() > kSingular * pivots.maxCoeff()))
    return Information::Constant(p, p, std::numeric_limits<double>::infinity());
  return ldlt.solve(Information::Identity(p, p));
}

Information breadOf(const NormalEquations& sums) {
  const double longer = sums.derivative > 0.0 ? sums.weight / sums.derivative
                                              : std::numeric_limits<double>::infinity();
  return longer * inverseOf(sums.squares);
}

Information sandwich(const util::SmallRef& bread, const util::SmallRef& meat) {
  if (!bread.allFinite()) return bread;
  return bread * meat * bread.transpose();
}

double smallSample(double n, double parameters) {
  return n / std::max(n - parameters, 1.0);
}

double meanSquare(const NormalEquations& sums, const RobustWeights& weights) {
  const double d = weights.dimensions();
  return smallSample(d * weights.equalMeasurements(), weights.parameters()) * sums.square /
         (d * sums.weight);
}

Information independentMeat(const NormalEquations& sums, const RobustWeights& weights) {
  return meanSquare(sums, weights) * sums.squares;
}

double inflationOfWeights(const NormalEquations& sums, const RobustWeights& weights) {
  const double d = weights.dimensions();
  const double n = static_cast<double>(weights.size());
  const double mean2 = std::pow(sums.derivative / n, 2);
  // We sum the squared derivative of t e with respect to e, averaged over all directions. e: the d
  // residuals of a measurement; t: its Student weight (`student`); f: kStudentFreedom. In the
  // direction of e, the derivative is t (2q - 1) with q = t f / (f + d); perpendicular to it, t.
  double squares = 0.0;
  for (std::size_t i = 0; i < weights.size(); ++i) {
    const double student = weights.weight[i] / weights.factor[i];
    const double q = student * (kStudentFreedom / (kStudentFreedom + d));
    squares += weights.weight[i] * student * (4.0 / d * q * (q - 1.0) + 1.0);
  }
  const double variance = squares / n - mean2;
  const double k =
      1.0 + weights.parameters() / (d * weights.equalMeasurements()) * variance / mean2;
  return k * k;
}

void ClusteredMeat::reset(Eigen::Index parameters, std::size_t most) {
  parameters_ = parameters;
  pulls_.assign(most, Step::Zero(parameters));
}

Information ClusteredMeat::meat() const {
  Information sum = Information::Zero(parameters_, parameters_);
  double clusters = 0.0;
  for (const Step& pull : pulls_) {
    if (pull.isZero(0.0)) continue;
    sum.noalias() += pull * pull.transpose();
    clusters += 1.0;
  }
  return smallSample(clusters, static_cast<double>(parameters_)) * sum;
}

Information ClusteredMeat::inflated(const Information& independent) const {
  const double inflation =
      independent.ldlt().solve(meat()).trace() / static_cast<double>(parameters_);
  return std::max(inflation, 1.0) * independent;
}

}  // namespace ktgp_orb::estimation
