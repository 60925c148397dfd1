#pragma once

#include <Eigen/SparseCore>
#include <vector>

namespace ktgp_orb::stabilization {

/// Minimises the cost of variables within bounds, subject to linear equations.
class LinearProgram {
 public:
  /// Returns the number of the new variable.
  int addVariable(double low, double high, double cost);
  /// Returns the number of the new equation, a sum of terms that equals `right`.
  int addEquation(double right);
  void addTerm(int equation, int variable, double factor);

  /// The values of the variables. Throws std::runtime_error without a solver or a solution.
  std::vector<double> solve() const;

 private:
  std::vector<double> low_;
  std::vector<double> high_;
  std::vector<double> cost_;
  std::vector<double> right_;
  std::vector<Eigen::Triplet<double>> terms_;  // equation, variable, factor
};

}  // namespace ktgp_orb::stabilization
