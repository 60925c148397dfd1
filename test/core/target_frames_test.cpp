// Flat targets in photographs and videos that nobody drew, with labels. Needs KTGP_ORB_DATA.
#include "evaluation/target_frames.h"

#include <gtest/gtest.h>

#include <array>
#include <cstdio>
#include <filesystem>

#include "files/input.h"
#include "test_data.h"

namespace ktgp_orb::tools {
namespace {

TEST(TargetFrames, AreFoundAtAllSizesAndFollowed) {
  const auto data = test::dataFolder();
  KTGP_ORB_REQUIRE_FOLDER(data, "KTGP_ORB_DATA");
  const std::string folder = *data + "/targets_real";
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << folder << " is missing: this test needs it";
  const LabelledTargets searched = searchLabelled(folder, {});
  std::printf("%s", toTable(searched).c_str());
  EXPECT_TRUE(searched.problems.empty());
  for (const LabelledTarget& row : searched.rows) {
    EXPECT_EQ(row.wrong, 0U) << row.source;
    EXPECT_EQ(row.others, 0U) << row.source;
    const bool is_small = row.source == "cube.mp4";  // 60 to 80 px in the video, at full size
    const std::array<double, kLabelledSizes.size()> least =
        is_small ? std::array<double, 5>{0.9, 0.9, 0.8, 0.35, 0.0}
                 : std::array<double, 5>{1.0, 1.0, 1.0, 1.0, 0.9};
    for (std::size_t s = 0; s < least.size(); ++s) {
      EXPECT_GE(static_cast<double>(row.found[s]), least[s] * static_cast<double>(row.frames))
          << row.target << " in " << row.source << " at " << kLabelledSizes[s];
    }
    if (row.all_frames == 0) continue;
    // Its picture has 80 px.
    EXPECT_GE(static_cast<double>(row.fixed),
              (is_small ? 0.7 : 1.0) * static_cast<double>(row.frames));
    EXPECT_GE(static_cast<double>(row.followed), 0.9 * static_cast<double>(row.frames));
    EXPECT_LE(row.longest_gap, 3U) << row.source;
  }
}

TEST(TargetFrames, ALabelFileThatCannotBeUsedIsRefused) {
  EXPECT_THROW(searchLabelled("/nowhere", {}), files::FileError);
}

}  // namespace
}  // namespace ktgp_orb::tools
