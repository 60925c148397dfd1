#include "core/prosac/verdict.h"

#include <cmath>

namespace ktgp_orb {

FalseAlarms::FalseAlarms(std::size_t sample_size, std::size_t pairs)
    : m_(static_cast<double>(sample_size)), n_(static_cast<double>(pairs)), k_(m_) {
  for (std::size_t i = 1; i <= sample_size; ++i) {
    const double x = static_cast<double>(i);
    log_subsets_ += std::log10((n_ - m_ + x) / x);
  }
  log_subsets_ += std::log10(std::max(n_ - m_, 1.0));
}

double FalseAlarms::next(double p) {
  // From k to k + 1, C(N, k) C(k, m) becomes (N - k) / (k + 1 - m) times as much.
  log_subsets_ += std::log10((n_ - k_) / (k_ + 1.0 - m_));
  k_ += 1.0;
  return log_subsets_ + (k_ - m_) * std::log10(std::min(p, 1.0));
}

}  // namespace ktgp_orb
