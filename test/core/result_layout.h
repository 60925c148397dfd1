#pragma once

#include <cstddef>

#include "ktgp_orb/ktgp_matcher.h"

namespace ktgp_orb::test {

/// Where members lie that follow anything which a compiler option could move.
struct ResultLayout {
  std::size_t match_result;
  std::size_t stages;
  std::size_t prosac_result;
  std::size_t covariance;
};

/// As the including file is compiled.
constexpr ResultLayout resultLayout() {
  return {sizeof(MatchResult), offsetof(MatchResult, stages), sizeof(ProsacResult),
          offsetof(ProsacResult, covariance)};
}

/// As a program sees it that was built for the widest vectors there are.
ResultLayout resultLayoutForWideVectors();

}  // namespace ktgp_orb::test
