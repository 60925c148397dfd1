#include "ktgp_orb/gms_filter.h"

#include <gtest/gtest.h>

#include <array>
#include <limits>
#include <random>
#include <stdexcept>
#include <tuple>

#include "allocation_counter.h"
#include "gms_problem.h"

namespace ktgp_orb {
namespace {

using test::mode;
using test::Problem;
using test::ProblemMaker;

/// A square image pair in which the target shows the reference rotated and zoomed about its centre;
/// `per_cell` matches in each cell of the finer grid, none near a line of the grid.
Problem perfectMotion(int quarter_turns, double zoom, int per_cell) {
  constexpr double kSide = 800.0;
  constexpr int kCells = 20;
  Problem problem;
  problem.reference.image_size = problem.target.image_size = {800, 800};
  std::mt19937 random(7);
  std::uniform_real_distribution<double> inside(0.1, 0.9);
  for (int cell = 0; cell < kCells * kCells; ++cell) {
    for (int i = 0; i < per_cell; ++i) {
      const double u = (cell % kCells + inside(random)) / kCells - 0.5;
      const int row = cell / kCells;
      const double v = (row + inside(random)) / kCells - 0.5;
      // u, v is the position in the image in which all is in view; from it to the other.
      double x = u;
      double y = v;
      for (int turn = 0; turn < quarter_turns; ++turn) {
        const double t = x;
        x = -y;  // x right, y down: clockwise on the screen
        y = t;
      }
      const double reference_zoom = zoom > 1.0 ? 1.0 / zoom : 1.0;
      const double target_zoom = zoom < 1.0 ? zoom : 1.0;
      problem.add(static_cast<float>((u * reference_zoom + 0.5) * kSide),
                  static_cast<float>((v * reference_zoom + 0.5) * kSide),
                  static_cast<float>((x * target_zoom + 0.5) * kSide),
                  static_cast<float>((y * target_zoom + 0.5) * kSide));
    }
  }
  return problem;
}

class GmsMotion : public testing::TestWithParam<std::tuple<int, double>> {};

TEST_P(GmsMotion, IsFoundAndAllOfAPerfectMatchSetIsKept) {
  const auto [quarter_turns, zoom] = GetParam();
  const Problem problem = perfectMotion(quarter_turns, zoom, 6);
  std::vector<Correspondence> matches = problem.matches;
  GmsFilter filter(mode(3));
  const GmsResult result = filter.filter(problem.reference, problem.target, matches);
  EXPECT_EQ(result.kept, matches.size());
  EXPECT_EQ(result.rotation_degrees, 90 * quarter_turns);
  EXPECT_EQ(result.scale, zoom);
}

INSTANTIATE_TEST_SUITE_P(TurnsAndZooms, GmsMotion,
                         testing::Combine(testing::Values(0, 1, 2, 3),
                                          testing::Values(1.0, 2.0, 0.5)));

TEST(GmsFilter, LosesATurnedPairWithoutRotation) {
  const Problem problem = perfectMotion(1, 1.0, 4);
  std::vector<Correspondence> matches = problem.matches;
  const GmsResult result = GmsFilter(mode(0)).filter(problem.reference, problem.target, matches);
  EXPECT_EQ(result.kept, 0u);
  EXPECT_EQ(result.low_support, matches.size());
}

TEST(GmsFilter, CountsKeypointsOnAndBeyondBordersAsOutside) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float huge = std::numeric_limits<float>::max();
  const std::array<cv::Point2f, 12> outside{{{640, 100},
                                             {100, 480},
                                             {640, 480},
                                             {-0.01F, 100},
                                             {100, -1},
                                             {700, 500},
                                             {nan, 100},
                                             {100, nan},
                                             {huge, 1},
                                             {1, -huge},
                                             {std::numeric_limits<float>::infinity(), 1},
                                             {-std::numeric_limits<float>::infinity(), 1}}};
  for (int m = 0; m < 4; ++m) {
    GmsFilter filter(mode(m));
    for (const bool in_target : {false, true}) {
      Problem problem;
      problem.reference.image_size = problem.target.image_size = {640, 480};
      for (const cv::Point2f& p : outside) {
        if (in_target) {
          problem.add(100, 100, p.x, p.y);
        } else {
          problem.add(p.x, p.y, 100, 100);
        }
      }
      for (int i = 0; i < 50; ++i) problem.add(100, 100, 100, 100);
      std::vector<Correspondence> matches = problem.matches;
      const GmsResult result = filter.filter(problem.reference, problem.target, matches);
      EXPECT_EQ(result.outside_grid, outside.size()) << "mode " << m;
      EXPECT_EQ(result.kept, 50u) << "mode " << m;
    }
  }
}

TEST(GmsFilter, SaysWhatRemovedEachMatch) {
  GmsOptions options;
  options.threshold = 2.0;
  Problem problem;
  problem.reference.image_size = problem.target.image_size = {200, 200};
  for (int i = 0; i < 9; ++i) problem.add(105, 105, 105, 105);  // kept: 9 >= 2 sqrt((9 + 1) / 9)
  problem.add(15, 15, 105, 105);                                // not where the nine go
  problem.add(55, 55, 25, 155);                                 // alone: 1 < 2 sqrt(1 / 9) is false
  problem.add(200, 55, 25, 155);                                // outside
  std::vector<Correspondence> matches = problem.matches;
  GmsResult result = GmsFilter(options).filter(problem.reference, problem.target, matches);
  EXPECT_EQ(result.kept, 10u);
  EXPECT_EQ(result.not_best_pair, 1u);
  EXPECT_EQ(result.low_support, 0u);
  EXPECT_EQ(result.outside_grid, 1u);

  options.threshold = 4.0;  // now 1 < 4 / 3, in every grid
  matches = problem.matches;
  result = GmsFilter(options).filter(problem.reference, problem.target, matches);
  EXPECT_EQ(result.kept, 9u);
  EXPECT_EQ(result.low_support, 1u);
}

TEST(GmsFilter, KeepsFewerForALargerThreshold) {
  ProblemMaker maker(4);
  for (int i = 0; i < 50; ++i) {
    GmsOptions options = mode(0);
    const Problem problem = maker.problem(500, options);
    std::size_t before = problem.matches.size();
    for (int halves = 0; halves < 18; ++halves) {
      options.threshold = 0.5 * halves;
      std::vector<Correspondence> matches = problem.matches;
      const std::size_t kept =
          GmsFilter(options).filter(problem.reference, problem.target, matches).kept;
      EXPECT_LE(kept, before) << "threshold " << options.threshold;
      before = kept;
    }
  }
}

TEST(GmsFilter, LeavesOtherLevelsAlone) {
  Problem problem = perfectMotion(0, 1.0, 6);
  for (std::size_t i = 0; i < problem.matches.size(); ++i) {
    Correspondence& c = problem.matches[i];
    if (i % 3 == 0) c.level = Level::knn;
    if (i % 3 == 0) c.reference_index = c.target_index = -1;  // not used
  }
  std::vector<Correspondence> matches = problem.matches;
  const GmsResult result = GmsFilter().filter(problem.reference, problem.target, matches);
  EXPECT_EQ(result.kept, countAtLeast(matches, Level::ktg));
  EXPECT_EQ(result.kept, countAtLeast(problem.matches, Level::kt));
  for (std::size_t i = 0; i < matches.size(); i += 3) EXPECT_EQ(matches[i].level, Level::knn);
}

TEST(GmsFilter, PassesAllWhereItIsSwitchedOff) {
  Problem problem = perfectMotion(0, 1.0, 6);
  for (std::size_t i = 0; i < problem.matches.size(); ++i) {
    if (i % 3 == 0) problem.matches[i].level = Level::knn;
    if (i % 3 == 1) problem.matches[i].target_index = 0;  // which motion statistics remove
  }
  GmsOptions options;
  options.enabled = false;
  std::vector<Correspondence> matches = problem.matches;
  const GmsResult result = GmsFilter(options).filter(problem.reference, problem.target, matches);
  EXPECT_EQ(result.kept, countAtLeast(problem.matches, Level::kt));
  EXPECT_EQ(result.kept, countAtLeast(matches, Level::ktg));
  EXPECT_EQ(result.outside_grid + result.not_best_pair + result.low_support, 0u);
  matches = problem.matches;
  EXPECT_LT(GmsFilter().filter(problem.reference, problem.target, matches).kept, result.kept);
}

TEST(GmsFilter, SwappedSizesChangeTheAnswer) {
  // The size comes only from Features: swapped sizes give another result.
  Problem problem = perfectMotion(0, 1.0, 3);
  problem.target.image_size = {800, 400};
  std::vector<Correspondence> matches = problem.matches;
  const GmsResult result = GmsFilter().filter(problem.reference, problem.target, matches);
  EXPECT_EQ(result.outside_grid, matches.size() / 2);
}

TEST(GmsFilter, RefusesBadFeaturesAndIndicesAndChangesNothing) {
  const Problem good = perfectMotion(0, 1.0, 3);
  const auto refuses = [](const Problem& problem) {
    std::vector<Correspondence> matches = problem.matches;
    EXPECT_THROW(GmsFilter().filter(problem.reference, problem.target, matches),
                 std::invalid_argument);
    EXPECT_EQ(countAtLeast(matches, Level::ktg), 0u);
  };
  for (const cv::Size& size : {cv::Size(0, 480), cv::Size(640, 0), cv::Size(-1, 5), cv::Size()}) {
    Problem bad = good;
    bad.reference.image_size = size;
    refuses(bad);
    bad = good;
    bad.target.image_size = size;
    refuses(bad);
  }
  const auto size = static_cast<std::int32_t>(good.matches.size());
  for (const std::int32_t index : {-1, size, std::numeric_limits<std::int32_t>::max()}) {
    Problem bad = good;
    bad.matches.back().reference_index = index;
    refuses(bad);
    bad = good;
    bad.matches.back().target_index = index;
    refuses(bad);
  }
}

TEST(GmsFilter, TakesEmptyFrames) {
  std::vector<Correspondence> none;
  const GmsResult result = GmsFilter(mode(3)).filter(Features{}, Features{}, none);
  EXPECT_EQ(result.kept, 0u);
  EXPECT_EQ(result.rotation_degrees, 0);
  EXPECT_EQ(result.scale, 1.0);
}

TEST(GmsFilter, RefusesOptionsOutsideTheirRanges) {
  for (const double bad : {-0.1, 1.1e6, std::numeric_limits<double>::quiet_NaN()}) {
    GmsOptions options;
    options.threshold = bad;
    EXPECT_THROW(GmsFilter{options}, std::invalid_argument);
  }
  for (const int bad : {-1, 201}) {
    GmsOptions options;
    options.grid_columns = bad;
    EXPECT_THROW(GmsFilter{options}, std::invalid_argument);
    options = {};
    options.grid_rows = bad;
    EXPECT_THROW(GmsFilter{options}, std::invalid_argument);
  }
}

/// Fewer matches, larger cells: as many matches in each as with 1000 on 20 x 20.
TEST(GmsFilter, AGridByTheNumberOfMatchesIsTheOneOfThatSize) {
  GmsOptions options = mode(3);
  options.grid_columns = options.grid_rows = 0;
  GmsFilter by_number(options);
  ProblemMaker maker(6);
  const std::pair<std::size_t, int> sizes[] = {{20, 5},   {90, 6},    {250, 10},
                                               {640, 16}, {1000, 20}, {4000, 20}};
  for (const auto& [matches, cells] : sizes) {
    GmsOptions fixed = options;
    fixed.grid_columns = fixed.grid_rows = cells;
    Problem problem = maker.problem(8000, fixed);
    while (problem.matches.size() < matches) problem = maker.problem(8000, fixed);
    problem.matches.resize(matches);
    std::vector<Correspondence> expected = problem.matches;
    GmsFilter(fixed).filter(problem.reference, problem.target, expected);
    by_number.filter(problem.reference, problem.target, problem.matches);
    EXPECT_EQ(test::maskOf(problem.matches), test::maskOf(expected)) << matches;
  }
}

TEST(GmsFilter, AllocatesNothingOnceItHasSeenTheLargestProblem) {
  ProblemMaker maker(5);
  GmsOptions options = mode(3);
  std::vector<Problem> problems;
  for (int i = 0; i < 10; ++i) problems.push_back(maker.problem(1500, options));
  std::vector<std::vector<Correspondence>> matches;
  for (const Problem& p : problems) matches.push_back(p.matches);
  options.grid_columns = options.grid_rows = 0;  // changes from problem to problem
  GmsFilter filter(options);
  const auto run = [&] {
    for (std::size_t i = 0; i < problems.size(); ++i) {
      for (Correspondence& c : matches[i]) c.level = Level::kt;
      filter.filter(problems[i].reference, problems[i].target, matches[i]);
    }
  };
  run();
  run();  // after this, both buffers that are swapped have their largest size
  const test::AllocationCounter allocations;
  run();
  EXPECT_EQ(allocations.count(), 0u);
}

}  // namespace
}  // namespace ktgp_orb
