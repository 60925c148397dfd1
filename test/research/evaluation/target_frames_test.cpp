// Flat targets in photographs and videos with labels: in some that nobody drew, which needs
// KTGP_ORB_DATA, and what the labels may be.
#include "evaluation/target_frames.h"

#include <gtest/gtest.h>

#include <array>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>
#include <string>

#include "files/input.h"
#include "orb_test_images.h"
#include "refusal.h"
#include "test_data.h"

namespace ktgp_orb::evaluation {
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

/// A folder with a target of 120x90 px at 100, 60 in a photograph and in the first four of six
/// frames of a video; the tests write the labels.
class DrawnFrames : public testing::Test {
 protected:
  void SetUp() override {
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directories(folder_);
    const cv::Mat target = test::drawnPicture({120, 90}, 1);
    cv::Mat with = test::drawnPicture({320, 240}, 2);
    const cv::Mat without = with.clone();
    target.copyTo(with(cv::Rect(100, 60, 120, 90)));
    for (const char* name : {"a.png", "a.jpg", "my target.png"}) write(name, target);
    write("scene.png", with);
    write("my scene.png", with);
    cv::VideoWriter video(folder_ + "/video.avi", cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), 10.0,
                          with.size(), false);
    for (int i = 0; i < 6; ++i) video.write(i < 4 ? with : without);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  void write(const std::string& name, const cv::Mat& image) {
    ASSERT_TRUE(cv::imwrite(folder_ + '/' + name, image));
  }

  LabelledTargets searched(const std::string& labels) {
    std::ofstream(folder_ + "/labels.json") << labels;
    return searchLabelled(folder_, {});
  }
  std::string refusalOf(const std::string& labels) {
    return test::refusalOf<files::FileError>([&] { searched(labels); });
  }

  const std::string folder_ = testing::TempDir() + "ktgp_orb_target_frames_test";
  const std::string target_ = R"("target": [[0, 0], [119, 0], [119, 89], [0, 89]])";
  const std::string there_ = "[[100, 60], [219, 60], [219, 149], [100, 149]]";
};

TEST_F(DrawnFrames, FoundAtTheirLabels) {
  const LabelledTargets answer = searched(R"({"a.png scene.png": {)" + target_ + R"(, "image": )" +
                                          there_ + R"(}, "a.png video.avi": {)" + target_ +
                                          R"(, "frames": {"1": )" + there_ + R"(, "5": []}}})");
  EXPECT_TRUE(answer.problems.empty());
  ASSERT_EQ(answer.rows.size(), 2U);
  for (const LabelledTarget& row : answer.rows) {
    EXPECT_EQ(row.frames, 1U) << row.source;
    EXPECT_EQ(row.found[0], 1U) << row.source;
    EXPECT_EQ(row.near, 1U) << row.source;
    EXPECT_EQ(row.wrong, 0U) << row.source;
  }
  EXPECT_EQ(answer.rows[1].followed, 1U);
  EXPECT_EQ(answer.rows[1].longest_gap, 1U) << "not where it is absent";
  EXPECT_NE(toTable(answer).find("<15"), std::string::npos);
}

TEST_F(DrawnFrames, AnAnswerWhereTheTargetIsNotThereIsWrong) {
  const LabelledTargets answer =
      searched(R"({"a.png scene.png": {)" + target_ + R"(, "image": []}})");
  EXPECT_EQ(answer.rows[0].frames, 0U);
  EXPECT_EQ(answer.rows[0].found[0] + answer.rows[0].near, 0U);
  EXPECT_GE(answer.rows[0].wrong, 2U) << "at full size, and in fixed mode";
}

TEST_F(DrawnFrames, NamesMayHaveBlanks) {
  const LabelledTargets answer =
      searched(R"({"my target.png my scene.png": {)" + target_ + R"(, "image": )" + there_ + "}}");
  ASSERT_EQ(answer.rows.size(), 1U);
  EXPECT_EQ(answer.rows[0].target, "my target.png");
  EXPECT_EQ(answer.rows[0].source, "my scene.png");
  EXPECT_EQ(answer.rows[0].found[0], 1U);
  test::expectSays(refusalOf(R"({"my target.png my picture.png": {)" + target_ + "}}"),
                   "\"my target.png my picture.png\" is not \"TARGET IMAGE\"");
}

TEST_F(DrawnFrames, LabelsThatCannotBeUsedAreNamed) {
  const auto expectRefused = [&](const std::string& labels, const std::string& words) {
    const std::string said = refusalOf(labels);
    EXPECT_EQ(said.find(folder_ + "/labels.json"), 0U) << said;
    test::expectSays(said, words);
  };
  const std::string begin = R"({"a.png video.avi": {)" + target_;
  for (const char* number : {"first", "-1", "1st", ""}) {
    expectRefused(begin + R"(, "frames": {")" + number + "\": " + there_ + "}}}",
                  std::string("\"a.png video.avi\" has a frame \"") + number + '"');
  }
  expectRefused(begin + R"(, "frames": {"1": [[1, 2]]}}})", "has 1 points in frame 1; expected 4");
  const std::string other =
      R"(, "frames": {}}, "a.jpg scene.png": {)" + target_ + R"(, "image": []}})";
  expectRefused(begin + other, "differ before");
  const std::string no_label =
      "\"a.png video.avi\" is not {\"target\": points, \"image\": points} or";
  const std::string no_point = "\"a.png video.avi\" has points that are no list of [x, y]";
  for (const auto& [rest, words] : std::vector<std::pair<std::string, std::string>>{
           {R"(, "image": [], "frames": {}}})", no_label},
           {"}}", no_label},
           {R"(, "frmaes": {"0": []}}})", no_label},
           {R"(, "frames": {"0": []}, "image ": []}})", no_label},
           {R"(, "frames": []}})", no_label},
           {R"(, "image": null}})", no_point},
           {R"(, "image": [100, 60, 120, 90]}})", no_point},
           {R"(, "image": [[100, 60, 120, 90]]}})", no_point},
           {R"(, "image": [["100", 60]]}})", no_point},
           {R"(, "image": [], "image": []}})", "has the key \"image\" twice"},
           {R"(, "image": []}, "a.png video.avi": {}})",
            "has the key \"a.png video.avi\" twice"}}) {
    expectRefused(begin + rest, words);
  }
  for (const char* nothing : {"{}", "[]", "1"}) expectRefused(nothing, "names no target");
  expectRefused("{\"a.png\": {" + target_ + "}}", "is not \"TARGET IMAGE\"");
  expectRefused("{", "parse");
}

TEST_F(DrawnFrames, LabelBeyondTheVideoIsNamedAndIgnored) {
  const LabelledTargets answer =
      searched(R"({"a.png video.avi": {)" + target_ + R"(, "frames": {"0": )" + there_ +
               R"(, "9999": )" + there_ + R"(, "6": []}}})");
  ASSERT_EQ(answer.problems.size(), 2U);
  test::expectSays(answer.problems[1],
                   "\"a.png video.avi\" has a label for frame 9999, and the video has 6 frames");
  EXPECT_EQ(answer.rows[0].frames, 1U);
  EXPECT_EQ(answer.rows[0].found[0], 1U);
}

TEST_F(DrawnFrames, AVideoThatCannotBeReadIsNamedAndDoesNotCount) {
  std::ofstream(folder_ + "/none.avi") << "no video";
  const LabelledTargets answer =
      searched(R"({"a.png none.avi": {)" + target_ + R"(, "frames": {"0": )" + there_ + "}}}");
  ASSERT_EQ(answer.problems.size(), 1U);
  test::expectSays(answer.problems[0], "none.avi: cannot be read as a video");
  EXPECT_EQ(answer.rows[0].frames, 0U);
}

TEST(TargetFrames, UnusableLabelFileIsRefused) {
  EXPECT_THROW(searchLabelled("/nowhere", {}), files::FileError);
}

}  // namespace
}  // namespace ktgp_orb::evaluation
