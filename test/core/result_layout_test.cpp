// A user's -march must not move the members of the library's types.
#include "result_layout.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <regex>
#include <set>
#include <string>

namespace ktgp_orb {
namespace {

TEST(ResultLayout, IsTheSameForEveryInstructionSet) {
  const test::LayoutEntry* wide = test::layoutForWideVectors();
  for (const test::LayoutEntry& here : test::kLayout) {
    EXPECT_EQ(here.bytes, wide->bytes) << here.name;
    ++wide;
  }
}

// Add new public types to the list.
TEST(ResultLayout, CoversEveryPublicType) {
  namespace fs = std::filesystem;
  std::set<std::string> covered;
  for (const test::LayoutEntry& entry : test::kLayout) {
    const std::string name = entry.name;
    covered.insert(name.substr(name.rfind(':') + 1));
  }
  std::size_t types = 0;
  const std::regex definition("(?:^|\n)(?:struct|class) (\\w+) (?:: \\w+ )?\\{");
  for (const fs::directory_entry& header : fs::directory_iterator(KTGP_ORB_PUBLIC_HEADERS)) {
    std::ifstream file(header.path().string());
    const std::string text(std::istreambuf_iterator<char>(file), {});
    for (std::sregex_iterator found(text.begin(), text.end(), definition), end; found != end;
         ++found) {
      EXPECT_EQ(covered.count((*found)[1]), 1u) << (*found)[1] << " of " << header.path();
      ++types;
    }
  }
  EXPECT_GT(types, 30u);
}

}  // namespace
}  // namespace ktgp_orb
