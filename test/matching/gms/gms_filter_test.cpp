#include "ktgp_orb/gms_filter.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <fstream>
#include <limits>
#include <random>
#include <sstream>
#include <stdexcept>
#include <string>
#include <tuple>
#include <vector>

#include "allocation_counter.h"
#include "dense_gms.h"
#include "test_data.h"

namespace ktgp_orb {
namespace {

/// Input of GmsFilter: two frames and their matches.
struct Problem {
  Features reference, target;
  std::vector<Correspondence> matches;

  void add(float reference_x, float reference_y, float target_x, float target_y) {
    const auto n = static_cast<std::int32_t>(matches.size());
    reference.keypoints.emplace_back(reference_x, reference_y, 31.0F);
    target.keypoints.emplace_back(target_x, target_y, 31.0F);
    matches.push_back({n, n, 10, 20, Level::kt});
  }
};

/// Modes in the order of the oracle's columns.
GmsOptions mode(int m) {
  GmsOptions options;
  options.rotation = m == 1 || m == 3;
  options.scale = m >= 2;
  return options;
}

/// Result of a filter for a problem, and the matches that it keeps.
struct Filtered {
  GmsResult result;
  std::vector<Correspondence> matches;
};

Filtered filtered(const Problem& problem, GmsFilter& filter) {
  Filtered of{{}, problem.matches};
  of.result = filter.filter(problem.reference, problem.target, of.matches);
  return of;
}

Filtered filtered(const Problem& problem, const GmsOptions& options = {}) {
  GmsFilter filter(options);
  return filtered(problem, filter);
}

std::vector<std::uint8_t> maskOf(const std::vector<Correspondence>& matches) {
  std::vector<std::uint8_t> mask;
  mask.reserve(matches.size());
  for (const Correspondence& c : matches) mask.push_back(c.level == Level::ktg ? 1 : 0);
  return mask;
}

/// Creates critical problems: empty ones, images of one pixel, motions, noise, many matches in one
/// cell, and keypoints on the lines between cells and beyond borders.
class ProblemMaker {
 public:
  explicit ProblemMaker(unsigned seed) : random_(seed) {}

  int between(int low, int high) { return std::uniform_int_distribution<int>(low, high)(random_); }
  double real(double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random_);
  }

  GmsOptions options(int largest_grid) {
    GmsOptions options = mode(between(0, 3));
    options.grid_columns = between(1, largest_grid);
    options.grid_rows = between(1, largest_grid);
    const std::array<double, 6> thresholds{0.0, 0.5, 1.0, 2.5, 6.0, real(0.0, 4.0)};
    options.threshold = thresholds[static_cast<std::size_t>(between(0, 5))];
    return options;
  }

  Problem problem(int largest_size, const GmsOptions& options) {
    Problem problem;
    problem.reference.image_size = size();
    problem.target.image_size = size();
    const int kind = between(0, 4);
    const double inliers = kind == 0 ? 0.0 : real(0.3, 1.0);
    const double angle = 0.25 * M_PI * between(0, 7) + real(-0.1, 0.1);
    const double zoom = std::pow(2.0, 0.5 * between(-2, 2)) * real(0.95, 1.05);
    const double spread = kind == 2 ? 0.02 : 0.6;  // 2: a crowd in one or two cells
    for (int n = between(0, largest_size); n > 0; --n) {
      // In units of the image, from its centre.
      const double x = real(-spread, spread);
      const double y = real(-spread, spread);
      double u = real(-0.6, 0.6);
      double v = real(-0.6, 0.6);
      if (kind == 4) u = 0.1 * v;  // the noise crowds a few target cells
      if (real(0.0, 1.0) < inliers) {
        u = zoom * (std::cos(angle) * x - std::sin(angle) * y);
        v = zoom * (std::sin(angle) * x + std::cos(angle) * y);
      }
      const bool on_lines = kind == 3;
      problem.add(pixel(x, problem.reference.image_size.width, options.grid_columns, on_lines),
                  pixel(y, problem.reference.image_size.height, options.grid_rows, on_lines),
                  pixel(u, problem.target.image_size.width, options.grid_columns, on_lines),
                  pixel(v, problem.target.image_size.height, options.grid_rows, on_lines));
    }
    return problem;
  }

 private:
  cv::Size size() {
    const int largest = between(0, 3) == 0 ? 3 : 2000;
    return {between(1, largest), between(1, largest)};
  }

  /// Pixel coordinate; with `on_lines` often exactly on a line of the grid or of its shifted copy.
  float pixel(double from_centre, int length, int cells, bool on_lines) {
    double position = (from_centre + 0.5) * length;
    if (on_lines && between(0, 1) == 0) {
      position = std::round(position / length * cells * 2.0) / (2.0 * cells) * length;
    }
    return static_cast<float>(position);
  }

  std::mt19937 random_;
};

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

TEST_P(GmsMotion, PerfectMatchesAreAllKept) {
  const auto [quarter_turns, zoom] = GetParam();
  const Problem problem = perfectMotion(quarter_turns, zoom, 6);
  const GmsResult result = filtered(problem, mode(3)).result;
  EXPECT_EQ(result.kept, problem.matches.size());
  EXPECT_EQ(result.rotation_degrees, 90 * quarter_turns);
  EXPECT_EQ(result.scale, zoom);
}

INSTANTIATE_TEST_SUITE_P(TurnsAndZooms, GmsMotion,
                         testing::Combine(testing::Values(0, 1, 2, 3),
                                          testing::Values(1.0, 2.0, 0.5)));

TEST(GmsFilter, LosesATurnedPairWithoutRotation) {
  const Problem problem = perfectMotion(1, 1.0, 4);
  const GmsResult result = filtered(problem, mode(0)).result;
  EXPECT_EQ(result.kept, 0u);
  EXPECT_EQ(result.low_support, problem.matches.size());
}

TEST(GmsFilter, CountsKeypointsOnAndBeyondBordersAsOutside) {
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float huge = std::numeric_limits<float>::max();
  const float infinity = std::numeric_limits<float>::infinity();
  const cv::Point2f outside[] = {{640, 100}, {100, 480}, {640, 480},    {-0.01F, 100},
                                 {100, -1},  {700, 500}, {nan, 100},    {100, nan},
                                 {huge, 1},  {1, -huge}, {infinity, 1}, {-infinity, 1}};
  for (int m = 0; m < 4; ++m) {
    GmsFilter filter(mode(m));
    for (const bool in_target : {false, true}) {
      Problem problem;
      problem.reference.image_size = problem.target.image_size = {640, 480};
      for (const cv::Point2f& p : outside) {
        if (in_target) problem.add(100, 100, p.x, p.y);
        if (!in_target) problem.add(p.x, p.y, 100, 100);
      }
      for (int i = 0; i < 50; ++i) problem.add(100, 100, 100, 100);
      const GmsResult result = filtered(problem, filter).result;
      EXPECT_EQ(result.outside_grid, std::size(outside)) << "mode " << m;
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
  GmsResult result = filtered(problem, options).result;
  EXPECT_EQ(result.kept, 10u);
  EXPECT_EQ(result.not_best_pair, 1u);
  EXPECT_EQ(result.low_support, 0u);
  EXPECT_EQ(result.outside_grid, 1u);

  options.threshold = 4.0;  // now 1 < 4 / 3, in every grid
  result = filtered(problem, options).result;
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
      const std::size_t kept = filtered(problem, options).result.kept;
      EXPECT_LE(kept, before) << "threshold " << options.threshold;
      before = kept;
    }
  }
}

TEST(GmsFilter, DoesNotChangeOtherLevels) {
  Problem problem = perfectMotion(0, 1.0, 6);
  for (std::size_t i = 0; i < problem.matches.size(); ++i) {
    Correspondence& c = problem.matches[i];
    if (i % 3 == 0) c.level = Level::knn;
    if (i % 3 == 0) c.reference_index = c.target_index = -1;  // not used
  }
  const auto [result, matches] = filtered(problem);
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
  const auto [result, matches] = filtered(problem, options);
  EXPECT_EQ(result.kept, countAtLeast(problem.matches, Level::kt));
  EXPECT_EQ(result.kept, countAtLeast(matches, Level::ktg));
  EXPECT_EQ(result.outside_grid + result.not_best_pair + result.low_support, 0u);
  EXPECT_LT(filtered(problem).result.kept, result.kept);
}

TEST(GmsFilter, SwappedSizesChangeTheAnswer) {
  // The size comes only from Features: swapped sizes give another result.
  Problem problem = perfectMotion(0, 1.0, 3);
  problem.target.image_size = {800, 400};
  EXPECT_EQ(filtered(problem).result.outside_grid, problem.matches.size() / 2);
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
  const GmsResult result = filtered({}, mode(3)).result;
  EXPECT_EQ(result.kept, 0u);
  EXPECT_EQ(result.rotation_degrees, 0);
  EXPECT_EQ(result.scale, 1.0);
}

/// Fewer matches, larger cells: as many matches in each as with 1000 on 20 x 20.
TEST(GmsFilter, AutomaticGridEqualsGridOfThatSize) {
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
    EXPECT_EQ(maskOf(filtered(problem, by_number).matches),
              maskOf(filtered(problem, fixed).matches))
        << matches;
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

// Its masks are those of the GMS authors' program and of a dense implementation.

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
    SCOPED_TRACE(m);
    const auto& expected = oracle.masks[static_cast<std::size_t>(m)];
    EXPECT_EQ(maskOf(filtered(oracle.problem, mode(m)).matches), expected);
    test::DenseGms dense(mode(m));
    EXPECT_EQ(dense.mask(oracle.problem.reference, oracle.problem.target, oracle.problem.matches),
              expected)
        << "dense reference";
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

GmsResult expectEqualToDense(GmsFilter& filter, const Problem& problem, const std::string& what) {
  SCOPED_TRACE(what);
  const auto [result, matches] = filtered(problem, filter);
  test::DenseGms dense(filter.options());
  EXPECT_EQ(maskOf(matches), dense.mask(problem.reference, problem.target, problem.matches));
  EXPECT_EQ(result.kept, dense.kept());
  EXPECT_EQ(result.rotation_degrees, dense.rotationDegrees());
  EXPECT_EQ(result.scale, dense.scale());
  EXPECT_EQ(result.kept + result.outside_grid + result.not_best_pair + result.low_support,
            matches.size());
  EXPECT_TRUE(filter.options().threshold != 0.0 || result.low_support == 0u);
  return result;
}

TEST(GmsEquality, EqualsTheDenseReferenceOnRandomProblems) {
  ProblemMaker maker(1);
  std::size_t kept_something = 0;
  for (int i = 0; i < 300 && !HasFailure(); ++i) {
    const GmsOptions options = maker.options(9);
    GmsFilter filter(options);  // reused for several problems, to find state that remains
    for (int k = 0; k < 12; ++k) {
      const Problem problem = maker.problem(i % 2 == 0 ? 500 : 60, options);
      const GmsResult result = expectEqualToDense(
          filter, problem, "problem " + std::to_string(i) + "/" + std::to_string(k));
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
      const auto x = static_cast<float>(maker.real(0.0, problem.reference.image_size.width));
      const auto y = static_cast<float>(maker.real(0.0, problem.reference.image_size.height));
      problem.add(x, y, x, y);
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
  for (const auto& [x, y] :
       {std::pair(190.F, 190.F), {210.F, 190.F}, {230.F, 190.F}, {190.F, 210.F}, {190.F, 230.F}}) {
    for (int i = 0; i < 400; ++i) {
      problem.add(10.F + 20.F * (i % 20), 10.F + 20.F * (i / 20), x, y);
    }
  }
  for (const int m : {2, 3}) {
    GmsFilter filter(mode(m));
    const GmsResult result = expectEqualToDense(filter, problem, "mode " + std::to_string(m));
    EXPECT_EQ(result.kept, 36u);
    EXPECT_EQ(result.scale, 0.5);
  }
}

}  // namespace
}  // namespace ktgp_orb
