#include "estimation/student.h"

#include <Eigen/Core>

#include "util/divide.h"

namespace ktgp_orb::estimation {

void RobustWeights::reset(std::size_t n, int dimensions, std::size_t parameters) {
  size_ = n;
  dimensions_ = dimensions;
  parameters_ = static_cast<double>(parameters);
  equal_ = static_cast<double>(n);
  const std::size_t padded = util::ceilDivide(n, kLanes) * kLanes;
  for (std::vector<double>* array : {&squared, &weight, &former}) array->assign(padded, 0.0);
  factor.assign(padded, 1.0);
  std::fill(factor.begin() + static_cast<std::ptrdiff_t>(n), factor.end(), 0.0);
}

void RobustWeights::setFactors(const std::vector<double>& factors, double equal) {
  std::copy_n(factors.begin(), size_, factor.begin());
  equal_ = equal;
}

void RobustWeights::estimateScale(double least) {
  using Lanes = Eigen::Array<double, kLanes, 1>;
  using Map = Eigen::Map<const Lanes>;
  constexpr int kRounds = 2;
  if (size_ == 0) return;
  const double fitted = dimensions_ * equal_ / freedom();
  for (int round = 0; round < kRounds; ++round) {
    Lanes weights = Lanes::Zero();
    Lanes cost = Lanes::Zero();
    for (std::size_t i = 0; i < size_; i += kLanes) {
      const Lanes square = Map(squared.data() + i);
      const Lanes w = studentWeight(square, scale2, dimensions_) * Map(factor.data() + i);
      weights += w;
      cost += w * square;
    }
    scale2 = std::max(fitted * cost.sum() / (dimensions_ * weights.sum()), least * least);
  }
}

}  // namespace ktgp_orb::estimation
