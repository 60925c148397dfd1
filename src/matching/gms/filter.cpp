#include "ktgp_orb/gms_filter.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "matching/gms/cell_pairs.h"
#include "util/keypoint_position.h"
#include "util/options_check.h"

namespace ktgp_orb {
namespace {

using util::requireInRange;

using gms::Grid;

// The scales have the same order as in the authors' program, because the order affects the result:
// if two scales keep the same number of matches, the first one wins.
const std::array<double, 5> kScales{1.0, 1.0 / 2.0, 1.0 / std::sqrt(2.0), std::sqrt(2.0), 2.0};

int scaled(int cells, double scale) {
  return std::max(1, static_cast<int>(cells * scale));
}

/// Returns the position of the keypoint if the image is scaled to [0, 1) x [0, 1). It is computed
/// in single precision as in the authors' program, because rounding decides the cell of a keypoint
/// on a line of the grid.
cv::Point2f normalised(const Features& features, std::int32_t index) {
  const cv::Point2f& p = util::imagePoint(features, index);
  return {p.x / static_cast<float>(features.image_size.width),
          p.y / static_cast<float>(features.image_size.height)};
}

cv::Point2f inCells(const cv::Point2f& normalised, const Grid& grid) {
  return {normalised.x * static_cast<float>(grid.columns),
          normalised.y * static_cast<float>(grid.rows)};
}

// Each match has one reference cell, and one target cell in each of the four shifted target grids.
// This makes four cell pairs. A match survives if, in one of the grids, its cell pair has the most
// matches of all pairs of the target cell, and the neighbouring pairs support it. We choose the
// rotation and the scale that keep the most matches.

/// A match that takes part in the votes.
struct Match {
  std::uint32_t number;   ///< index among the correspondences
  cv::Point2f reference;  ///< normalised position in the reference image
};

bool survives(unsigned votes, unsigned rotation) {
  return (votes >> rotation & 1u) != 0;
}

/// Returns true if the keypoint has a position.
bool isPlaced(const Features& features, std::int32_t index) {
  const cv::Point2f& point = features.keypoints[static_cast<std::size_t>(index)].pt;
  return std::isfinite(point.x) && std::isfinite(point.y);
}

/// Returns the result for a filter that is switched off: all matches pass whose keypoints have a
/// position.
GmsResult passPlaced(const Features& reference, const Features& target,
                     std::vector<Correspondence>& correspondences) {
  for (const Correspondence& c : correspondences) {
    if (c.level != Level::kt) continue;
    util::requireKeypoint(reference, c.reference_index, "reference");
    util::requireKeypoint(target, c.target_index, "target");
  }
  GmsResult result;
  for (Correspondence& c : correspondences) {
    if (c.level != Level::kt) continue;
    if (!isPlaced(reference, c.reference_index) || !isPlaced(target, c.target_index)) {
      ++result.outside_grid;
      continue;
    }
    c.level = Level::ktg;
    ++result.kept;
  }
  return result;
}

}  // namespace

struct GmsFilter::Impl {
  explicit Impl(const GmsOptions& wanted) : options(wanted) {
    setGrid(wanted.grid_columns, wanted.grid_rows);
  }

  void setGrid(int columns, int rows);
  void fitGrid(const std::vector<Correspondence>& correspondences);
  void takeIn(const Features& reference, const Features& target,
              const std::vector<Correspondence>& correspondences);
  void tryScale(std::size_t scale);
  void vote(const Grid& reference_grid);
  GmsResult apply(std::vector<Correspondence>& correspondences) const;

  GmsOptions options;
  Grid target_grid{0, 0};
  std::vector<Grid> reference_grids;  ///< reference grid for each scale of kScales

  std::vector<Match> matches;
  /// For each of the four shifted grids, the target cell of each match.
  std::array<std::vector<std::uint32_t>, 4> target_cells;
  std::size_t outside = 0;  ///< number of correspondences outside the target image

  // The next four members hold the data for the scale that is being tried.
  std::vector<std::uint32_t> reference_cells;  ///< reference cell of each match
  util::Buckets reference_order;
  gms::CellPairs pairs;
  gms::Votes votes;  ///< votes for each match from the four shifted grids

  // The best rotation and scale so far, and the number of matches that they keep.
  std::size_t most_kept = 0;
  unsigned best_rotation = 0;
  std::size_t best_scale = 0;
  gms::Votes best_votes;
};

void GmsFilter::Impl::setGrid(int columns, int rows) {
  target_grid = Grid(columns, rows);
  reference_grids.clear();
  for (std::size_t s = 0; s < (options.scale ? kScales.size() : 1); ++s) {
    reference_grids.emplace_back(scaled(columns, kScales[s]), scaled(rows, kScales[s]));
  }
}

/// If the options do not set the size of the grid, derives it from the number of matches: on
/// average a cell has as many matches as in the paper's 20 x 20 grid with 1000 matches. This
/// gives at least 5 and at most 20 cells along each side.
void GmsFilter::Impl::fitGrid(const std::vector<Correspondence>& correspondences) {
  if (options.grid_columns != 0 && options.grid_rows != 0) return;
  constexpr double kMatchesPerCell = 2.5;
  const auto count = static_cast<double>(
      std::count_if(correspondences.begin(), correspondences.end(),
                    [](const Correspondence& c) { return c.level == Level::kt; }));
  const int cells = std::clamp(cvRound(std::sqrt(count / kMatchesPerCell)), 5, 20);
  setGrid(options.grid_columns != 0 ? options.grid_columns : cells,
          options.grid_rows != 0 ? options.grid_rows : cells);
}

void GmsFilter::Impl::takeIn(const Features& reference, const Features& target,
                             const std::vector<Correspondence>& correspondences) {
  matches.clear();
  for (std::vector<std::uint32_t>& cells : target_cells) cells.clear();
  outside = 0;
  for (std::size_t i = 0; i < correspondences.size(); ++i) {
    const Correspondence& c = correspondences[i];
    if (c.level != Level::kt) continue;
    util::requireKeypoint(reference, c.reference_index, "reference");
    util::requireKeypoint(target, c.target_index, "target");
    const cv::Point2f p = inCells(normalised(target, c.target_index), target_grid);
    if (target_grid.cellAt(p.x, p.y) == target_grid.noCell()) {
      ++outside;
      continue;
    }
    matches.push_back({static_cast<std::uint32_t>(i), normalised(reference, c.reference_index)});
    for (int shift = 0; shift < 4; ++shift) {
      // Half of the first column and of the first row of a shifted grid is outside the image, so
      // matches there do not count.
      const int right = shift % 2;
      const int down = shift / 2;
      target_cells[static_cast<std::size_t>(shift)].push_back(
          target_grid.cellAt(p.x + 0.5 * right, p.y + 0.5 * down, right, down));
    }
  }
}

void GmsFilter::Impl::vote(const Grid& grid) {
  reference_cells.clear();
  votes.clear();
  for (const Match& match : matches) {
    const cv::Point2f p = inCells(match.reference, grid);
    reference_cells.push_back(grid.cellAt(p.x, p.y));
    votes.push_back(reference_cells.back() == grid.noCell() ? 0 : gms::kOnGrid);
  }
  reference_order.sort(matches.size(), grid.cells + 1,
                       [&](std::size_t i) { return reference_cells[i]; });
  for (const std::vector<std::uint32_t>& cells : target_cells) {
    pairs.count(target_grid, grid, reference_order, reference_cells, cells);
    pairs.vote(options.threshold, options.rotation ? gms::kRing : 1, votes);
  }
}

void GmsFilter::Impl::tryScale(std::size_t scale) {
  vote(reference_grids[scale]);
  bool wins = scale == 0;
  for (unsigned m = 0; m < (options.rotation ? gms::kRing : 1); ++m) {
    const auto kept = static_cast<std::size_t>(
        std::count_if(votes.begin(), votes.end(), [m](unsigned v) { return survives(v, m); }));
    if (kept <= most_kept) continue;
    most_kept = kept;
    best_rotation = m;
    best_scale = scale;
    wins = true;
  }
  if (wins) std::swap(votes, best_votes);
}

GmsResult GmsFilter::Impl::apply(std::vector<Correspondence>& correspondences) const {
  GmsResult result;
  result.rotation_degrees = 45 * static_cast<int>(best_rotation);
  result.scale = kScales[best_scale];
  result.outside_grid = outside;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    const unsigned votes_of_match = best_votes[i];
    if (survives(votes_of_match, best_rotation)) {
      correspondences[matches[i].number].level = Level::ktg;
      ++result.kept;
    } else if ((votes_of_match & gms::kOnGrid) == 0) {
      ++result.outside_grid;
    } else if ((votes_of_match & gms::kInBestPair) != 0) {
      ++result.low_support;
    } else {
      ++result.not_best_pair;
    }
  }
  return result;
}

GmsFilter::GmsFilter(const GmsOptions& options) {
  requireInRange("gms threshold", options.threshold, 0.0, 1e6);
  requireInRange("grid_columns", options.grid_columns, 0, 200);
  requireInRange("grid_rows", options.grid_rows, 0, 200);
  impl_ = std::make_unique<Impl>(options);
}

GmsFilter::~GmsFilter() = default;
GmsFilter::GmsFilter(GmsFilter&&) noexcept = default;
GmsFilter& GmsFilter::operator=(GmsFilter&&) noexcept = default;

const GmsOptions& GmsFilter::options() const {
  return impl_->options;
}

GmsResult GmsFilter::filter(const Features& reference, const Features& target,
                            std::vector<Correspondence>& correspondences) {
  if (!impl_->options.enabled) return passPlaced(reference, target, correspondences);
  requireImageSize(reference, "reference");
  requireImageSize(target, "target");
  Impl& impl = *impl_;
  impl.fitGrid(correspondences);
  impl.takeIn(reference, target, correspondences);
  impl.most_kept = 0;
  impl.best_rotation = 0;
  impl.best_scale = 0;
  for (std::size_t scale = 0; scale < impl.reference_grids.size(); ++scale) impl.tryScale(scale);
  return impl.apply(correspondences);
}

}  // namespace ktgp_orb
