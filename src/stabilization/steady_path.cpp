#include "stabilization/steady_path.h"

#include <Eigen/LU>
#include <Eigen/SparseCore>
#include <algorithm>
#include <array>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>

#include "homography/transform.h"

#ifdef KTGP_ORB_HAVE_CLP
#include <Clp_C_Interface.h>
#endif

namespace ktgp_orb {
namespace {

using Corners = std::array<Eigen::Vector2d, 4>;
using Points = std::vector<Eigen::Vector2d>;
using Steps = std::vector<std::optional<Eigen::Matrix3d>>;

// Weights in the sum that steadyPath() minimises: of the motion that remains in the steady picture,
// of its change, and of the change of its change. The values are from the paper that steady_path.h
// cites.
constexpr double kStanding = 10.0;
constexpr double kEven = 1.0;
constexpr double kAccelerating = 100.0;
/// Weight of the motion of the window within the frame; it applies where the motion of the camera
/// is unknown.
constexpr double kHolding = 1000.0;
// Each corner of the window may move by this much relative to the middle of the window, as a share
// of the window's half size. This limit preserves the shape of the window.
constexpr double kShape = 0.15;
// A long recording is solved in overlapping parts. This loses little, because the correction of a
// frame hardly depends on frames far ahead.
constexpr std::size_t kPart = 300;  // frames
constexpr std::size_t kOverlap =
    100;  // frames at the end of a part; the next part solves them again
// The next part begins this many frames before the overlap. The corrections of these frames are
// already known and do not change any more.
constexpr std::size_t kKnown = 3;

/// A point of the window (its middle or a corner). `low`, `high` and `best` contain, for each
/// frame, the lowest allowed, the highest allowed and the best correction of the point's position,
/// px.
struct Track {
  Eigen::Vector2d place;  ///< position without correction, px
  Points low;
  Points high;
  Points best;
};

/// A linear program: minimises the cost of variables that have bounds and satisfy linear equations.
class LinearProgram {
 public:
  int addVariable(double low, double high, double cost) {
    low_.push_back(low);
    high_.push_back(high);
    cost_.push_back(cost);
    return static_cast<int>(cost_.size()) - 1;
  }
  /// Adds an unknown without bounds. `cost`: cost per unit of its absolute value. The unknown is
  /// the difference of two variables that are not negative. Returns the number of the first
  /// variable.
  int addUnknown(double cost) {
    constexpr double kAny = std::numeric_limits<double>::infinity();
    addVariable(0.0, kAny, cost);
    return addVariable(0.0, kAny, cost) - 1;
  }
  /// Adds an equation whose terms sum up to `right`. Returns the number of the equation.
  int addEquation(double right) {
    right_.push_back(right);
    return static_cast<int>(right_.size()) - 1;
  }
  void addTerm(int equation, int variable, double factor) {
    terms_.emplace_back(equation, variable, factor);
  }
  void addUnknownTerm(int equation, int unknown, double factor) {
    addTerm(equation, unknown, factor);
    addTerm(equation, unknown + 1, -factor);
  }

  /// Returns the values of the variables. Throws std::runtime_error if this build has no solver, or
  /// if the program has no solution.
  std::vector<double> solve() const;

 private:
  std::vector<double> low_;
  std::vector<double> high_;
  std::vector<double> cost_;
  std::vector<double> right_;
  std::vector<Eigen::Triplet<double>> terms_;  // for each term: equation, variable and factor
};

#ifdef KTGP_ORB_HAVE_CLP

std::vector<double> LinearProgram::solve() const {
  // Clp needs the matrix column by column, which is how Eigen stores sparse matrices.
  Eigen::SparseMatrix<double> matrix(static_cast<int>(right_.size()),
                                     static_cast<int>(cost_.size()));
  matrix.setFromTriplets(terms_.begin(), terms_.end());
  const std::unique_ptr<Clp_Simplex, void (*)(Clp_Simplex*)> model(Clp_newModel(), Clp_deleteModel);
  Clp_setLogLevel(model.get(), 0);
  const std::vector<CoinBigIndex> begins(matrix.outerIndexPtr(),
                                         matrix.outerIndexPtr() + matrix.cols() + 1);
  Clp_loadProblem(model.get(), matrix.cols(), matrix.rows(), begins.data(), matrix.innerIndexPtr(),
                  matrix.valuePtr(), low_.data(), high_.data(), cost_.data(), right_.data(),
                  right_.data());
  Clp_dual(model.get(), 0);
  if (Clp_status(model.get()) != 0) {
    throw std::runtime_error("the linear program of the steady path has no solution");
  }
  const double* const values = Clp_getColSolution(model.get());
  return {values, values + cost_.size()};
}

#else

std::vector<double> LinearProgram::solve() const {
  throw std::runtime_error("this program was built without Clp (Debian's coinor-libclp-dev)");
}

#endif

/// For each frame, the numbers of two unknowns of the program, for x and y. Empty for a frame where
/// a path begins.
using Unknowns = std::vector<std::optional<std::array<int, 2>>>;

Unknowns differences(LinearProgram& program, const Unknowns& of, double weight) {
  Unknowns found(of.size());
  for (std::size_t t = 1; t < of.size(); ++t) {
    if (!of[t] || !of[t - 1]) continue;
    found[t].emplace();
    for (std::size_t k = 0; k < 2; ++k) {
      const int equation = program.addEquation(0.0);
      (*found[t])[k] = program.addUnknown(weight);
      program.addUnknownTerm(equation, (*of[t])[k], 1.0);
      program.addUnknownTerm(equation, (*of[t - 1])[k], -1.0);
      program.addUnknownTerm(equation, (*found[t])[k], -1.0);
    }
  }
  return found;
}

/// For each frame, adds two unknowns to the program: how far the scene at the point still moves in
/// the steady picture, in x and in y. This motion is the position to which the homography maps the
/// point from the previous frame, minus the position of the point in this frame. Near the
/// corrections in track.best, it is a linear function of the corrections.
Unknowns motions(LinearProgram& program, const Steps& steps, const Track& track, std::size_t begin,
                 const std::vector<std::array<int, 2>>& corrections) {
  Unknowns found(corrections.size());
  for (std::size_t t = 1; t < corrections.size(); ++t) {
    const auto& step = steps[begin + t];
    const Eigen::Vector2d& before = track.best[begin + t - 1];
    Eigen::Vector2d moved = Eigen::Vector2d::Zero();
    Eigen::Matrix2d slope = Eigen::Matrix2d::Identity();
    if (step) {
      slope = homography::jacobianByPoint(*step, track.place + before);
      moved = homography::project(*step, track.place + before) - track.place - slope * before;
      found[t].emplace();
    }
    for (std::size_t k = 0; k < 2; ++k) {
      const auto row = static_cast<Eigen::Index>(k);
      const int equation = program.addEquation(moved(row));
      program.addTerm(equation, corrections[t][k], 1.0);
      program.addTerm(equation, corrections[t - 1][0], -slope(row, 0));
      program.addTerm(equation, corrections[t - 1][1], -slope(row, 1));
      const int motion = program.addUnknown(step ? kStanding : kHolding);
      program.addUnknownTerm(equation, motion, 1.0);
      if (step) (*found[t])[k] = motion;
    }
  }
  return found;
}

/// Finds the best corrections of the frames in [begin, end). The first `known` of them are already
/// known and stay unchanged.
void solvePart(const Steps& steps, std::size_t begin, std::size_t end, std::size_t known,
               Track& track) {
  LinearProgram program;
  std::vector<std::array<int, 2>> corrections(end - begin);
  for (std::size_t t = 0; t < corrections.size(); ++t) {
    const Points& low = t < known ? track.best : track.low;
    const Points& high = t < known ? track.best : track.high;
    for (std::size_t k = 0; k < 2; ++k) {
      const auto row = static_cast<Eigen::Index>(k);
      corrections[t][k] = program.addVariable(low[begin + t](row), high[begin + t](row), 0.0);
    }
  }
  const Unknowns first = motions(program, steps, track, begin, corrections);
  const Unknowns second = differences(program, first, kEven);
  differences(program, second, kAccelerating);
  const std::vector<double> values = program.solve();
  for (std::size_t t = known; t < corrections.size(); ++t) {
    const Eigen::Vector2d found(values[static_cast<std::size_t>(corrections[t][0])],
                                values[static_cast<std::size_t>(corrections[t][1])]);
    // The solver may exceed a bound by its tolerance, so clamp the values.
    track.best[begin + t] = found.cwiseMax(track.low[begin + t]).cwiseMin(track.high[begin + t]);
  }
}

void solve(const Steps& steps, Track& track) {
  std::size_t begin = 0;
  std::size_t known = 0;
  while (true) {
    const std::size_t end = std::min(steps.size(), begin + kPart);
    solvePart(steps, begin, end, known, track);
    if (end == steps.size()) return;
    begin = end - kOverlap - kKnown;
    known = kKnown;
  }
}

/// Removes homographies that mirror the frame or move a part of it behind the camera; at such a
/// frame a new path begins.
Steps usableSteps(const Steps& steps, const Corners& corners) {
  Steps usable = steps;
  for (auto& step : usable) {
    if (!step) continue;
    const bool seen = step->allFinite() && homography::scaleLastToOne(*step) &&
                      homography::keepsPlaneInView(*step, corners);
    if (!seen) step.reset();
  }
  if (!usable.empty()) usable.front().reset();
  return usable;
}

}  // namespace

bool hasSteadyPath() {
#ifdef KTGP_ORB_HAVE_CLP
  return true;
#else
  return false;
#endif
}

std::vector<Eigen::Matrix3d> steadyPath(const Steps& all_steps, const cv::Size& size,
                                        double max_crop) {
  if (!(max_crop >= 0.01 && max_crop <= 0.4)) {
    throw std::invalid_argument("max_crop is " + std::to_string(max_crop) +
                                "; expected a value in [0.01, 0.4]");
  }
  const Corners corners = homography::imageCorners(size, {});
  const Steps steps = usableSteps(all_steps, corners);
  const std::size_t count = steps.size();
  if (count == 0) return {};
  const Eigen::Vector2d centre = 0.5 * (corners[0] + corners[2]);
  const Eigen::Vector2d margin = 2.0 * max_crop * centre;
  const Eigen::Vector2d shape = kShape * (centre - margin);

  Track middle{centre, Points(count, -margin), Points(count, margin),
               Points(count, Eigen::Vector2d::Zero())};
  solve(steps, middle);
  std::array<Track, 4> window;
  for (std::size_t i = 0; i < window.size(); ++i) {
    window[i] = middle;
    window[i].place = centre + (1.0 - 2.0 * max_crop) * (corners[i] - centre);
    for (std::size_t t = 0; t < count; ++t) {
      window[i].low[t] = (middle.best[t] - shape).cwiseMax(-margin);
      window[i].high[t] = (middle.best[t] + shape).cwiseMin(margin);
    }
    solve(steps, window[i]);
  }

  const double area = static_cast<double>(size.area());
  std::vector<Eigen::Matrix3d> warps(count);
  for (std::size_t t = 0; t < count; ++t) {
    Corners seen;
    for (std::size_t i = 0; i < seen.size(); ++i) seen[i] = window[i].place + window[i].best[t];
    // solveFourPoints() fails only if the image has no area. The warp is then the identity.
    warps[t].setIdentity();
    homography::solveFourPoints(seen, corners, 1e-6 * area, 1e-6 * area, warps[t]);
    warps[t] /= warps[t](2, 2);
  }
  return warps;
}

}  // namespace ktgp_orb
