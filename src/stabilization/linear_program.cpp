#include "stabilization/linear_program.h"

#include "stabilization/steady_path.h"

#include <memory>
#include <stdexcept>

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
  terms_.emplace_back(equation, variable, factor);
}

#ifdef KTGP_ORB_HAVE_CLP

std::vector<double> LinearProgram::solve() const {
  // Column by column, as Clp takes it.
  Eigen::SparseMatrix<double> matrix(static_cast<int>(right_.size()),
                                     static_cast<int>(cost_.size()));
  matrix.setFromTriplets(terms_.begin(), terms_.end());
  const std::unique_ptr<Clp_Simplex, void (*)(Clp_Simplex*)> model(Clp_newModel(), Clp_deleteModel);
  Clp_setLogLevel(model.get(), 0);
  const std::vector<CoinBigIndex> begins(matrix.outerIndexPtr(),
                                         matrix.outerIndexPtr() + matrix.cols() + 1);
  Clp_loadProblem(model.get(), matrix.cols(), matrix.rows(), begins.data(), matrix.innerIndexPtr(),
                  matrix.valuePtr(), low_.data(), high_.data(), cost_.data(), right_.data(),
                  right_.data());
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
