#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <limits>
#include <utility>

#include "estimation/student.h"
#include "util/small_matrix.h"

namespace ktgp_orb::estimation {

/// Maximum number of parameters of a fit: the eight entries of a homography.
inline constexpr int kMostParameters = 8;
/// A symmetric matrix and a vector, with a row for each parameter; neither uses heap memory. All
/// problems use these two types, so that the functions below are compiled only once.
using Information = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor,
                                  kMostParameters, kMostParameters>;
using Step = Eigen::Matrix<double, Eigen::Dynamic, 1, Eigen::ColMajor, kMostParameters, 1>;

/// Sums over all measurements, for one state of the fit. e: residuals of a measurement. J: Jacobian
/// of e with respect to the step. w = t c: weight of the measurement, where t is the weight from
/// Student's distribution (studentWeight) and c is the factor from RobustWeights::setFactors().
struct NormalEquations {
  Information squares;      ///< normal matrix: sum of J' w J
  Step gradient;            ///< sum of J' w e
  double weight = 0.0;      ///< sum of w
  double derivative = 0.0;  ///< sum of c d(t e)/de, averaged over all directions of e
  double square = 0.0;      ///< sum of c t² e²; see meanSquare()
  double cost = 0.0;        ///< sum of w e²
  /// Sum of w e² with the errors of this state, but the weights w of the previous state.
  double former_cost = 0.0;
};

struct FitRules {
  int most_steps = 30;
  double converged = 1e-5;  ///< the fit ends when no entry of a step is larger than this
  /// Limit for the entries of a step. If an entry is larger, the step is computed again with more
  /// damping.
  double longest = std::numeric_limits<double>::infinity();
  double least_scale = 0.0;  ///< lower limit of the scale of the errors
  double first_damping = 0.0;
  /// Upper limit of the factor by which findStep() lengthens a step.
  double lengthening = 2.0;
};

enum class FitEnd { undetermined, most_steps, converged };

/// Solves s (J'wJ + damping diag(J'wJ)) step = -J'we for `step`. J'wJ and J'we are `squares` and
/// `gradient` of `sums`, and s = derivative / weight. Returns false if the step is not determined
/// or is longer than the rules allow. The factor s turns J'wJ into the second derivative of the
/// likelihood. Without it each step would be too short, since the weights fall as the errors grow.
bool findStep(const NormalEquations& sums, double damping, const FitRules& rules, Step& step);

/// Fits a state by maximum likelihood for errors with Student's t distribution. Before each
/// Levenberg-Marquardt step, the weights and the scale are computed again. If the problem leaves
/// the weights empty, the fit is plain least squares. The class Problem knows the geometry and must
/// provide:
///
///   using State = …;                                   the estimated value
///   State moved(const State&, const Step&) const;      the state after a step; a step has
///                                                      entries of the order of 1
///   void linearise(const State&, RobustWeights&, NormalEquations&);
///
/// linearise() computes the errors, the weights and the sums for a state. A problem that can
/// evaluate one measurement at a time calls lineariseEach() for this. Reuses its buffers from call
/// to call.
template <typename Problem>
class RobustFit {
 public:
  using State = typename Problem::State;

  /// The weights. The caller must reset them before a fit. After minimise(), they are the weights
  /// at the fitted state.
  RobustWeights& weights() { return weights_; }
  const RobustWeights& weights() const { return weights_; }
  const NormalEquations& sums() const { return sums_; }

  /// Takes one undamped step with the current scale of the errors. Returns false if the
  /// measurements do not determine the step.
  bool step(Problem& problem, const FitRules& rules, State& state) {
    problem.linearise(state, weights_, sums_);
    if (!findStep(sums_, 0.0, rules, step_)) return false;
    state = problem.moved(state, step_);
    return true;
  }

  /// Fits `state`, starting with the current scale of the errors.
  FitEnd minimise(Problem& problem, const FitRules& rules, State& state) {
    // After a step that did not reduce the cost, the damping is at least this.
    constexpr double kLeastDamping = 1e-4;
    constexpr double kMostDamping = 1e12;  // with more damping, steps are too small to help
    problem.linearise(state, weights_, sums_);
    double damping = rules.first_damping;
    for (int i = 0; i < rules.most_steps; ++i) {
      if (damping > kMostDamping) return FitEnd::undetermined;
      if (!findStep(sums_, damping, rules, step_)) {
        damping = std::max(10.0 * damping, kLeastDamping);
        continue;
      }
      const State candidate = problem.moved(state, step_);
      const bool is_small = step_.cwiseAbs().maxCoeff() < rules.converged;
      const double cost = sums_.cost;
      weights_.estimateScale(rules.least_scale);
      problem.linearise(candidate, weights_, trial_);
      if (trial_.former_cost <= cost) {
        state = candidate;
        sums_ = trial_;
        damping *= 0.1;
      } else {
        problem.linearise(state, weights_, sums_);
        damping = std::max(10.0 * damping, kLeastDamping);
      }
      if (is_small) return FitEnd::converged;
    }
    return FitEnd::most_steps;
  }

 private:
  RobustWeights weights_;
  NormalEquations sums_;
  NormalEquations trial_;
  Step step_;
};

/// Sets `sums` for plain least squares; a problem calls it in linearise(). `residual`: all
/// residuals in one vector, scaled so that their covariance is the identity. `jacobian`: Jacobian
/// of `residual` with respect to the step.
void setLeastSquares(const util::SmallRef& residual, const util::SmallRef& jacobian,
                     NormalEquations& sums);

/// Does the work of linearise() for a problem that evaluates one measurement at a time. The problem
/// must provide:
///
///   static constexpr int kResiduals, kParameters;      kParameters: at most kMostParameters
///   void evaluate(std::size_t i, const State&, Residual&, Jacobian&) const;
///
/// Residual and Jacobian are Eigen matrices of kResiduals x 1 and kResiduals x kParameters.
template <typename Problem, typename State>
void lineariseEach(const Problem& problem, const State& state, RobustWeights& weights,
                   NormalEquations& sums) {
  constexpr int kResiduals = Problem::kResiduals;
  constexpr int kParameters = Problem::kParameters;
  Eigen::Matrix<double, kParameters, kParameters> squares =
      Eigen::Matrix<double, kParameters, kParameters>::Zero();
  Eigen::Matrix<double, kParameters, 1> gradient = Eigen::Matrix<double, kParameters, 1>::Zero();
  Eigen::Matrix<double, kResiduals, 1> residual;
  Eigen::Matrix<double, kResiduals, kParameters> jacobian;
  sums = {};
  std::swap(weights.weight, weights.former);
  for (std::size_t i = 0; i < weights.size(); ++i) {
    problem.evaluate(i, state, residual, jacobian);
    const double square = residual.squaredNorm();
    const double student = studentWeight(square, weights.scale2, kResiduals);
    const double w = student * weights.factor[i];
    squares.noalias() += w * jacobian.transpose() * jacobian;
    gradient.noalias() += w * jacobian.transpose() * residual;
    sums.weight += w;
    // For sums.derivative, we need the derivative of t e with respect to e, averaged over all
    // directions. e: residuals of the measurement; t: its Student weight (`student`). In the
    // direction of e, the derivative is t (2q - 1); perpendicular to it, t. Here q = t f / (f +
    // kResiduals) with f = kStudentFreedom.
    const double q = student * (kStudentFreedom / (kStudentFreedom + kResiduals));
    sums.derivative += w * (1.0 - 2.0 / kResiduals * (1.0 - q));
    sums.square += w * student * square;
    sums.cost += w * square;
    sums.former_cost += weights.former[i] * square;
    weights.squared[i] = square;
    weights.weight[i] = w;
  }
  sums.squares = squares;
  sums.gradient = gradient;
}

}  // namespace ktgp_orb::estimation
