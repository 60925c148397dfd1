// Annotated points as truth: what is read, what is refused, and how a homography is held to them.
#include "evaluation/truth_points.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>

#include "files/input.h"

namespace ktgp_orb::tools {
namespace {

std::string written(const std::string& text) {
  const auto* test = ::testing::UnitTest::GetInstance()->current_test_info();
  const std::string file =
      (std::filesystem::temp_directory_path() / (std::string(test->name()) + ".points")).string();
  std::ofstream(file) << text;
  return file;
}

std::string refusal(const std::string& text) {
  try {
    readPoints(written(text));
  } catch (const files::FileError& error) {
    return error.what();
  }
  return "";
}

const std::string kRows = "0 0 10 20\n100 0 110 20\r\n\n 100 50\t110 70\n0.5 50 10.5 7e1\n";

TEST(TruthPoints, AreReadRowByRow) {
  const std::vector<AnnotatedPoint> points = readPoints(written(kRows));
  ASSERT_EQ(points.size(), 4U);
  EXPECT_EQ(points[2].reference, Eigen::Vector2d(100, 50));
  EXPECT_EQ(points[3].target, Eigen::Vector2d(10.5, 70));
}

TEST(TruthPoints, NeedFourNumbersARowAndFourRows) {
  EXPECT_NE(refusal("0 0 1 1\n1 0 2 1\n1 1 2 2\n").find("holds 3"), std::string::npos);
  EXPECT_NE(refusal("").find("holds 0"), std::string::npos);
  EXPECT_NE(refusal(kRows + "1 2 3\n").find("line 6"), std::string::npos);
  EXPECT_NE(refusal(kRows + "1 2 3 4 5\n1 2 3\n").find("line 6"), std::string::npos);
  EXPECT_NE(refusal("a b c d\n" + kRows).find("line 1"), std::string::npos);
  EXPECT_NE(refusal(kRows + "1 2 3 nan\n").find("line 6"), std::string::npos);
  EXPECT_THROW(readPoints("/nowhere/at.all"), files::FileError);
}

TEST(TruthPoints, DetermineAHomographyUnlessOnALine) {
  const Eigen::Matrix3d h = homographyThrough(readPoints(written(kRows)));
  EXPECT_NEAR(h(0, 2) / h(2, 2), 10.0, 1e-9);
  EXPECT_NEAR(h(1, 2) / h(2, 2), 20.0, 1e-9);
  const std::vector<AnnotatedPoint> same(4, {{1, 2}, {3, 4}});
  EXPECT_THROW(homographyThrough(same), std::invalid_argument);
}

TEST(TruthPoints, TheErrorIsTheMeanDistance) {
  std::vector<AnnotatedPoint> points{{{0, 0}, {3, 4}}, {{10, 0}, {10, 0}}};
  EXPECT_DOUBLE_EQ(meanTransferError(Eigen::Matrix3d::Identity(), points), 2.5);
  Eigen::Matrix3d horizon = Eigen::Matrix3d::Identity();
  horizon.row(2) << 1.0, 0.0, -10.0;  // through the second point
  EXPECT_TRUE(std::isinf(meanTransferError(horizon, points)));
}

TEST(TruthPoints, AreWithinACovarianceThatIsAsLargeAsTheErrors) {
  UncertainHomography estimate;
  estimate.homography.setIdentity();
  estimate.covariance.setZero();
  std::vector<AnnotatedPoint> points{{{0, 0}, {5, 0}}, {{10, 0}, {15, 0}}};
  EXPECT_FALSE(isWithinCovariance(estimate, points, 1.0));  // 5 px are five deviations
  EXPECT_TRUE(isWithinCovariance(estimate, points, 2.0));
  estimate.covariance(2, 2) = 25.0;  // of the shift along x
  EXPECT_TRUE(isWithinCovariance(estimate, points, 1.0));
}

}  // namespace
}  // namespace ktgp_orb::tools
