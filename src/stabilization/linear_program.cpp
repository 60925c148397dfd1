#include "stabilization/linear_program.h"

#include "stabilization/steady_path.h"

#include <algorithm>
#include <memory>
#include <stdexcept>
#include <tuple>

#ifdef KTGP_ORB_HAVE_CLP
#include <Clp_C_Interface.h>
#endif

namespace ktgp_orb::stabilization {

int LinearProgram::addVariable(double low, double high, double cost) {
  low_.push_back(low);
  high_.push_back(high);
  cost_.push_back(cost);
  return static_cast<int>(cost_.size()) - 1;
}

int LinearProgram::addEquation(double right) {
  right_.push_back(right);
  return static_cast<int>(right_.size()) - 1;
}

void LinearProgram::addTerm(int equation, int variable, double factor) {
  terms_.push_back({variable, equation, factor});
}

#ifdef KTGP_ORB_HAVE_CLP

std::vector<double> LinearProgram::solve() const {
  // Clp takes the matrix column by column.
  std::vector<Term> terms = terms_;
  std::sort(terms.begin(), terms.end(), [](const Term& a, const Term& b) {
    return std::tie(a.variable, a.equation) < std::tie(b.variable, b.equation);
  });
  std::vector<CoinBigIndex> begin(cost_.size() + 1, 0);
  std::vector<int> equations;
  std::vector<double> factors;
  for (const Term& term : terms) {
    ++begin[static_cast<std::size_t>(term.variable) + 1];
    equations.push_back(term.equation);
    factors.push_back(term.factor);
  }
  for (std::size_t i = 1; i < begin.size(); ++i) begin[i] += begin[i - 1];

  const std::unique_ptr<Clp_Simplex, void (*)(Clp_Simplex*)> model(Clp_newModel(), Clp_deleteModel);
  Clp_setLogLevel(model.get(), 0);
  Clp_loadProblem(model.get(), static_cast<int>(cost_.size()), static_cast<int>(right_.size()),
                  begin.data(), equations.data(), factors.data(), low_.data(), high_.data(),
                  cost_.data(), right_.data(), right_.data());
  Clp_dual(model.get(), 0);
  if (Clp_status(model.get()) != 0) {
    throw std::runtime_error("the linear program of the steady path has no solution");
  }
  const double* const values = Clp_getColSolution(model.get());
  return {values, values + cost_.size()};
}

#else

std::vector<double> LinearProgram::solve() const {
  throw std::runtime_error("this program was built without Clp (Debian's coinor-libclp-dev)");
}

#endif

}  // namespace ktgp_orb::stabilization

bool ktgp_orb::hasSteadyPath() {
#ifdef KTGP_ORB_HAVE_CLP
  return true;
#else
  return false;
#endif
}
