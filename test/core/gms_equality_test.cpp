// Compares GmsFilter's masks with those of the GMS authors' program and of a dense implementation.

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <fstream>
#include <sstream>
#include <string>

#include "dense_gms.h"
#include "gms_problem.h"
#include "ktgp_orb/gms_filter.h"
#include "test_data.h"

namespace ktgp_orb {
namespace {

using test::maskOf;
using test::mode;
using test::Problem;
using test::ProblemMaker;

struct OracleFile {
  Problem problem;
  std::array<std::vector<std::uint8_t>, 4> masks;
};

OracleFile readOracle(const std::string& file) {
  OracleFile oracle;
  std::ifstream in(file);
  std::string line;
  std::getline(in, line);
  cv::Size& left = oracle.problem.target.image_size;
  cv::Size& right = oracle.problem.reference.image_size;
  if (std::sscanf(line.c_str(), "# left image %dx%d right image %dx%d", &left.width, &left.height,
                  &right.width, &right.height) != 4) {
    ADD_FAILURE() << file << ": unreadable first line: " << line;
    return oracle;
  }
  std::getline(in, line);
  while (std::getline(in, line)) {
    std::replace(line.begin(), line.end(), ',', ' ');
    std::istringstream row(line);
    float xl = 0, yl = 0, xr = 0, yr = 0;
    row >> xl >> yl >> xr >> yr;
    oracle.problem.add(xr, yr, xl, yl);
    for (auto& mask : oracle.masks) {
      int kept = -1;
      row >> kept;
      mask.push_back(static_cast<std::uint8_t>(kept));
    }
    EXPECT_FALSE(row.fail()) << file << ": " << line;
  }
  return oracle;
}

class GmsOracle : public testing::TestWithParam<const char*> {};

TEST_P(GmsOracle, MasksAreEqualRowForRowInAllModes) {
  const auto folder = test::oracleFolder();
  KTGP_ORB_REQUIRE_FOLDER(folder, "KTGP_ORB_ORACLE");
  const OracleFile oracle = readOracle(*folder + "/gms/" + GetParam() + ".csv");
  ASSERT_FALSE(oracle.problem.matches.empty());
  for (int m = 0; m < 4; ++m) {
    GmsFilter filter(mode(m));
    std::vector<Correspondence> matches = oracle.problem.matches;
    filter.filter(oracle.problem.reference, oracle.problem.target, matches);
    EXPECT_EQ(maskOf(matches), oracle.masks[static_cast<std::size_t>(m)]) << "mode " << m;

    test::DenseGms dense(mode(m));
    EXPECT_EQ(dense.mask(oracle.problem.reference, oracle.problem.target, oracle.problem.matches),
              oracle.masks[static_cast<std::size_t>(m)])
        << "dense reference, mode " << m;
  }
}

INSTANTIATE_TEST_SUITE_P(AllFiles, GmsOracle,
                         testing::Values("boat_1-2_all", "boat_1-2_tf66", "boat_1-4_all",
                                         "boat_1-4_tf66", "boat_1-6_all", "boat_1-6_tf66",
                                         "leuven_1-2_all", "leuven_1-2_tf66", "leuven_1-4_all",
                                         "leuven_1-4_tf66", "leuven_1-6_all", "leuven_1-6_tf66"),
                         [](const auto& info) {
                           std::string name = info.param;
                           std::replace(name.begin(), name.end(), '-', '_');
                           return name;
                         });

void expectEqualToDense(GmsFilter& filter, const Problem& problem, const std::string& what) {
  std::vector<Correspondence> matches = problem.matches;
  const GmsResult result = filter.filter(problem.reference, problem.target, matches);
  test::DenseGms dense(filter.options());
  EXPECT_EQ(maskOf(matches), dense.mask(problem.reference, problem.target, problem.matches))
      << what;
  EXPECT_EQ(result.kept, dense.kept()) << what;
  EXPECT_EQ(result.rotation_degrees, dense.rotationDegrees()) << what;
  EXPECT_EQ(result.scale, dense.scale()) << what;
  EXPECT_EQ(result.kept + result.outside_grid + result.not_best_pair + result.low_support,
            matches.size())
      << what;
  if (filter.options().threshold == 0.0) {
    EXPECT_EQ(result.low_support, 0u) << what;
  }
}

TEST(GmsEquality, EqualsTheDenseReferenceOnRandomProblems) {
  ProblemMaker maker(1);
  std::size_t kept_something = 0;
  for (int i = 0; i < 300 && !HasFailure(); ++i) {
    const GmsOptions options = maker.options(9);
    GmsFilter filter(options);  // reused for several problems, to find state that remains
    for (int k = 0; k < 12; ++k) {
      const Problem problem = maker.problem(i % 2 == 0 ? 500 : 60, options);
      expectEqualToDense(filter, problem, "problem " + std::to_string(i) + "/" + std::to_string(k));
      std::vector<Correspondence> matches = problem.matches;
      const GmsResult result = filter.filter(problem.reference, problem.target, matches);
      if (result.kept > 0) ++kept_something;
    }
  }
  EXPECT_GT(kept_something, 1000u) << "the problems are too hard to test anything";
}

TEST(GmsEquality, EqualsTheDenseReferenceOnTheDefaultGrid) {
  ProblemMaker maker(2);
  for (int i = 0; i < 60; ++i) {
    GmsOptions options = mode(i % 4);
    options.threshold = i % 3 == 0 ? 6.0 : 2.0;
    GmsFilter filter(options);
    expectEqualToDense(filter, maker.problem(2000, options), "problem " + std::to_string(i));
  }
}

TEST(GmsEquality, EqualsTheDenseReferenceForEverySizeFromNothing) {
  ProblemMaker maker(3);
  GmsOptions options = mode(3);
  options.grid_columns = 5;
  options.grid_rows = 4;
  options.threshold = 1.5;
  GmsFilter filter(options);
  for (int n = 0; n <= 200; ++n) {
    Problem problem = maker.problem(0, options);
    while (static_cast<int>(problem.matches.size()) < n) {
      const double x = maker.real(0.0, problem.reference.image_size.width);
      const double y = maker.real(0.0, problem.reference.image_size.height);
      problem.add(static_cast<float>(x), static_cast<float>(y), static_cast<float>(x),
                  static_cast<float>(y));
    }
    expectEqualToDense(filter, problem, std::to_string(n) + " matches");
  }
}

TEST(GmsEquality, DoesNotRuleOutAPairForNeighboursThatDoNotCount) {
  // The pair wins with the reference grid halved. Its reference cell is in the corner, so five
  // neighbours of its target cell do not count: these have many matches, which lead to other cells.
  Problem problem;
  problem.reference.image_size = problem.target.image_size = {400, 400};
  for (int i = 0; i < 36; ++i) {
    const float x = i % 2 == 0 ? 10 : 30;
    const float y = i % 4 < 2 ? 10 : 30;
    problem.add(x, y, 210, 210);
  }
  const std::array<cv::Point2f, 5> crowded{
      {{190, 190}, {210, 190}, {230, 190}, {190, 210}, {190, 230}}};
  for (const cv::Point2f& p : crowded) {
    for (int i = 0; i < 400; ++i) {
      problem.add(static_cast<float>(10 + 20 * (i % 20)), static_cast<float>(10 + 20 * (i / 20)),
                  p.x, p.y);
    }
  }
  for (const int m : {2, 3}) {
    GmsFilter filter(mode(m));
    std::vector<Correspondence> matches = problem.matches;
    const GmsResult result = filter.filter(problem.reference, problem.target, matches);
    EXPECT_EQ(result.kept, 36u);
    EXPECT_EQ(result.scale, 0.5);
    expectEqualToDense(filter, problem, "mode " + std::to_string(m));
  }
}

}  // namespace
}  // namespace ktgp_orb
