// A user's -march must not move the members of the results that the library fills in.
#include "result_layout.h"

#include <gtest/gtest.h>

namespace ktgp_orb {
namespace {

TEST(ResultLayout, IsTheSameForEveryInstructionSet) {
  constexpr test::ResultLayout here = test::resultLayout();
  const test::ResultLayout wide = test::resultLayoutForWideVectors();
  EXPECT_EQ(here.match_result, wide.match_result);
  EXPECT_EQ(here.stages, wide.stages);
  EXPECT_EQ(here.prosac_result, wide.prosac_result);
  EXPECT_EQ(here.covariance, wide.covariance);
}

}  // namespace
}  // namespace ktgp_orb
