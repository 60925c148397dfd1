#include "estimation/least_squares.h"

namespace ktgp_orb::estimation {

void setLeastSquares(const util::SmallRef& residual, const util::SmallRef& jacobian,
                     NormalEquations& sums) {
  sums.squares = util::times(jacobian.transpose(), jacobian);
  sums.gradient = util::times(jacobian.transpose(), residual);
  sums.weight = sums.derivative = 1.0;
  sums.square = sums.cost = sums.former_cost = residual.squaredNorm();
}

}  // namespace ktgp_orb::estimation
