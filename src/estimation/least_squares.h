#pragma once

#include "estimation/robust_fit.h"
#include "util/small_matrix.h"

namespace ktgp_orb::estimation {

/// linearise() of a problem of plain least squares. `residual`: with the covariance I; `jacobian`:
/// of the residual by the step.
void setLeastSquares(const util::SmallRef& residual, const util::SmallRef& jacobian,
                     NormalEquations& sums);

}  // namespace ktgp_orb::estimation
