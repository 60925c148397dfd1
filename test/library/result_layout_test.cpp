// A user's -march must not move the members of the library's types.
#include "result_layout.h"

#include <gtest/gtest.h>

#include <iterator>

namespace ktgp_orb {
namespace {

TEST(ResultLayout, SameForEveryInstructionSet) {
  ASSERT_GT(std::size(test::kLayout), 30u);
  const test::LayoutEntry* wide = test::layoutForWideVectors();
  for (const test::LayoutEntry& here : test::kLayout) {
    EXPECT_EQ(here.size, wide->size) << here.name;
    EXPECT_EQ(here.alignment, wide->alignment) << here.name;
    ++wide;
  }
}

}  // namespace
}  // namespace ktgp_orb
