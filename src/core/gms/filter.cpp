#include "ktgp_orb/gms_filter.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <stdexcept>
#include <string>

#include "core/gms/cell_pairs.h"
#include "core/gms/grid.h"
#include "core/util/keypoint_position.h"
#include "core/util/options_check.h"

namespace ktgp_orb {
namespace {

using util::imagePoint;
using util::requireInRange;

using gms::Grid;
using gms::kNoCell;

// The order of the authors, which decides for equal numbers.
const std::array<double, 5> kScales{1.0, 1.0 / 2.0, 1.0 / std::sqrt(2.0), std::sqrt(2.0), 2.0};

int scaled(int cells, double scale) {
  return std::max(1, static_cast<int>(cells * scale));
}

void requireSize(const Features& features, const std::string& name) {
  if (features.empty() || (features.image_size.width > 0 && features.image_size.height > 0)) return;
  throw std::invalid_argument(name + " has image size " +
                              std::to_string(features.image_size.width) + "x" +
                              std::to_string(features.image_size.height) +
                              "; expected the width and height of its image in pixels");
}

bool isIndexOf(const Features& features, std::int32_t index) {
  return index >= 0 && static_cast<std::size_t>(index) < features.size();
}

[[noreturn]] void refuseIndex(const Features& features, std::int32_t index,
                              const std::string& name) {
  throw std::invalid_argument(name + " index of a correspondence is " + std::to_string(index) +
                              "; expected one of the frame's " + std::to_string(features.size()) +
                              " keypoints, counted from 0");
}

/// The keypoint's position with the image scaled to [0, 1) x [0, 1), in single precision as in the
/// authors' program: rounding decides the cell of a keypoint on a line of the grid.
cv::Point2f normalised(const Features& features, std::int32_t index) {
  const cv::Point2f& p = imagePoint(features, index);
  return {p.x / static_cast<float>(features.image_size.width),
          p.y / static_cast<float>(features.image_size.height)};
}

/// Whether a position in cells is on the grid; false for NaN.
bool isOnGrid(const cv::Point2f& cells, const Grid& grid) {
  return cells.x >= 0.0F && cells.x < static_cast<float>(grid.columns) && cells.y >= 0.0F &&
         cells.y < static_cast<float>(grid.rows);
}

cv::Point2f inCells(const cv::Point2f& normalised, const Grid& grid) {
  return {normalised.x * static_cast<float>(grid.columns),
          normalised.y * static_cast<float>(grid.rows)};
}

// How the support is computed. A match is in one cell of each of the four shifted target grids, and
// in one reference cell. It survives if in one of the grids
// - its pair of cells is the best of its target cell (most matches lead there), and
// - that pair has support, for the current rotation.
// The support depends only on the cell and the rotation: one bit for each of the eight rotations of
// the neighbourhood. So judge computes a Verdict for every occupied target cell. vote collects for
// every match the bits of its four cells, if they name its reference cell. The number of matches
// with a bit is the number that survives with that rotation. The rotation and scale that keep most
// matches win.

/// The verdict of one shifted grid on the matches of one target cell.
struct Verdict {
  std::uint32_t best_cell = kNoCell;  ///< reference cell of its best pair
  std::uint32_t bits = 0;             ///< bit m: that pair has support with rotation m; kInBestPair
};
constexpr unsigned kInBestPair = 1u << gms::kRing;

/// In place of a reference cell: no cell has this index.
constexpr std::uint32_t kRuledOut = std::numeric_limits<std::uint32_t>::max();

/// The combined verdicts of the four shifted grids for every match.
struct Votes {
  std::vector<std::uint32_t> reference_cell;
  std::vector<std::uint16_t> bits;  ///< as in Verdict

  bool survives(std::size_t match, unsigned rotation) const {
    return (bits[match] >> rotation & 1u) != 0;
  }
  bool isInBestPair(std::size_t match) const { return (bits[match] & kInBestPair) != 0; }
  std::size_t survivors(unsigned rotation) const {
    std::size_t n = 0;
    for (const std::uint16_t b : bits) n += b >> rotation & 1u;
    return n;
  }
};

/// The best rotation and scale so far.
struct Winner {
  std::size_t kept = 0;
  unsigned rotation = 0;
  std::size_t scale = 0;
  Votes votes;
};

/// The filter when it is switched off.
GmsResult passAll(std::vector<Correspondence>& correspondences) {
  GmsResult result;
  for (Correspondence& c : correspondences) {
    if (c.level != Level::kt) continue;
    c.level = Level::ktg;
    ++result.kept;
  }
  return result;
}

}  // namespace

struct GmsFilter::Impl {
  explicit Impl(const GmsOptions& wanted)
      : options(wanted), target_grid(wanted.grid_columns, wanted.grid_rows) {
    for (std::size_t s = 0; s < (wanted.scale ? kScales.size() : 1); ++s) {
      reference_grids.emplace_back(scaled(wanted.grid_columns, kScales[s]),
                                   scaled(wanted.grid_rows, kScales[s]));
    }
  }

  void takeIn(const Features& reference, const Features& target,
              const std::vector<Correspondence>& correspondences);
  void tryScale(std::size_t scale);
  void countPairs(const Grid& reference_grid);
  void ruleOut();                     ///< fills `candidates`
  std::size_t mostSurvivors() const;  ///< an upper bound over all rotations, from `candidates`
  void judge(bool all);               ///< fills the verdicts
  void vote();                        ///< from the verdicts to the votes
  GmsResult apply(std::vector<Correspondence>& correspondences) const;

  GmsOptions options;
  Grid target_grid;
  std::vector<Grid> reference_grids;  ///< in the order of kScales

  // The matches that take part: three arrays of equal length.
  std::vector<std::uint32_t> number;    ///< index among the correspondences
  std::vector<cv::Point2f> reference;   ///< normalised position in the reference image
  std::vector<gms::HalfCell> position;  ///< in the target image
  std::size_t outside = 0;              ///< correspondences left out: not in the target image

  // One per shift of the target grid.
  std::array<gms::CellMembers, 4> members;
  std::array<gms::CellPairs, 4> pairs;
  std::array<std::vector<Verdict>, 4> verdicts;  ///< by place, and one for "in no cell"
  /// By place: reference cell of the best pair if it may have support, else kRuledOut.
  std::array<std::vector<std::uint32_t>, 4> candidates;

  Votes votes;  ///< for the current scale
  Winner winner;
};

void GmsFilter::Impl::takeIn(const Features& reference_frame, const Features& target_frame,
                             const std::vector<Correspondence>& correspondences) {
  number.resize(correspondences.size());
  reference.resize(correspondences.size());
  position.resize(correspondences.size());
  outside = 0;
  std::size_t n = 0;
  for (std::size_t i = 0; i < correspondences.size(); ++i) {
    const Correspondence& c = correspondences[i];
    if (c.level != Level::kt) continue;
    if (!isIndexOf(reference_frame, c.reference_index)) {
      refuseIndex(reference_frame, c.reference_index, "reference");
    }
    if (!isIndexOf(target_frame, c.target_index)) {
      refuseIndex(target_frame, c.target_index, "target");
    }
    const cv::Point2f cell = inCells(normalised(target_frame, c.target_index), target_grid);
    if (!isOnGrid(cell, target_grid)) {
      ++outside;
      continue;
    }
    number[n] = static_cast<std::uint32_t>(i);
    reference[n] = normalised(reference_frame, c.reference_index);
    position[n] = {static_cast<std::uint16_t>(2.0F * cell.x),
                   static_cast<std::uint16_t>(2.0F * cell.y)};
    ++n;
  }
  number.resize(n);
  reference.resize(n);
  position.resize(n);
  for (unsigned shift = 0; shift < members.size(); ++shift) {
    members[shift].assign(target_grid, (shift & 1u) != 0, (shift & 2u) != 0, position);
  }
}

void GmsFilter::Impl::countPairs(const Grid& grid) {
  votes.reference_cell.resize(reference.size());
  for (std::size_t i = 0; i < reference.size(); ++i) {
    const cv::Point2f cell = inCells(reference[i], grid);
    votes.reference_cell[i] = isOnGrid(cell, grid)
                                  ? grid.cell(static_cast<int>(cell.x), static_cast<int>(cell.y))
                                  : kNoCell;
  }
  for (std::size_t shift = 0; shift < members.size(); ++shift) {
    pairs[shift].count(members[shift], target_grid, grid, votes.reference_cell);
    verdicts[shift].resize(members[shift].places() + 1);
    verdicts[shift].back() = {};
    candidates[shift].resize(members[shift].places() + 1);
    candidates[shift].back() = kRuledOut;
  }
}

/// A best pair cannot have more support than the matches around it. Checking this is far cheaper
/// than judging the pair.
void GmsFilter::Impl::ruleOut() {
  for (std::size_t shift = 0; shift < members.size(); ++shift) {
    for (std::size_t place = 0; place < members[shift].places(); ++place) {
      const bool may = pairs[shift].maySupport(place, options.threshold);
      candidates[shift][place] = may ? pairs[shift].best(place) : kRuledOut;
    }
  }
}

std::size_t GmsFilter::Impl::mostSurvivors() const {
  std::size_t most = 0;
  for (std::size_t i = 0; i < reference.size(); ++i) {
    bool may_survive = false;
    for (std::size_t shift = 0; shift < members.size(); ++shift) {
      const std::uint32_t place = members[shift].placeOfMatch()[i];
      may_survive |= candidates[shift][place] == votes.reference_cell[i];
    }
    most += may_survive ? 1 : 0;
  }
  return most;
}

/// `all`: also the pairs that ruleOut() would rule out.
void GmsFilter::Impl::judge(bool all) {
  for (std::size_t shift = 0; shift < members.size(); ++shift) {
    const gms::CellPairs& p = pairs[shift];
    for (std::size_t place = 0; place < members[shift].places(); ++place) {
      Verdict& verdict = verdicts[shift][place];
      verdict = {p.best(place), kInBestPair};
      if (!all && candidates[shift][place] == kRuledOut) continue;
      verdict.bits |= p.supportedRotations(place, options.threshold, options.rotation);
    }
  }
}

/// A match survives if any of the four grids supports it.
void GmsFilter::Impl::vote() {
  votes.bits.resize(reference.size());
  for (std::size_t i = 0; i < reference.size(); ++i) {
    unsigned bits = 0;
    for (std::size_t shift = 0; shift < members.size(); ++shift) {
      const Verdict& verdict = verdicts[shift][members[shift].placeOfMatch()[i]];
      bits |= verdict.best_cell == votes.reference_cell[i] ? verdict.bits : 0;
    }
    votes.bits[i] = static_cast<std::uint16_t>(bits);
  }
}

void GmsFilter::Impl::tryScale(std::size_t scale) {
  countPairs(reference_grids[scale]);
  const bool first = scale == 0;
  if (!first) {
    ruleOut();
    if (mostSurvivors() <= winner.kept) return;
  }
  judge(first);
  vote();
  bool wins = first;
  for (unsigned m = 0; m < (options.rotation ? gms::kRing : 1); ++m) {
    const std::size_t kept = votes.survivors(m);
    if (kept <= winner.kept) continue;
    winner.kept = kept;
    winner.rotation = m;
    winner.scale = scale;
    wins = true;
  }
  if (wins) std::swap(votes, winner.votes);
}

GmsResult GmsFilter::Impl::apply(std::vector<Correspondence>& correspondences) const {
  GmsResult result;
  result.rotation_degrees = 45 * static_cast<int>(winner.rotation);
  result.scale = kScales[winner.scale];
  result.outside_grid = outside;
  for (std::size_t i = 0; i < number.size(); ++i) {
    if (winner.votes.survives(i, winner.rotation)) {
      correspondences[number[i]].level = Level::ktg;
      ++result.kept;
    } else if (winner.votes.reference_cell[i] == kNoCell) {
      ++result.outside_grid;
    } else if (winner.votes.isInBestPair(i)) {
      ++result.low_support;
    } else {
      ++result.not_best_pair;
    }
  }
  return result;
}

GmsFilter::GmsFilter(const GmsOptions& options) {
  requireInRange("gms threshold", options.threshold, 0.0, 1e6);
  requireInRange("grid_columns", options.grid_columns, 1, 200);
  requireInRange("grid_rows", options.grid_rows, 1, 200);
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
  if (!impl_->options.enabled) return passAll(correspondences);
  requireSize(reference, "reference");
  requireSize(target, "target");
  Impl& impl = *impl_;
  impl.takeIn(reference, target, correspondences);
  impl.winner.kept = 0;
  impl.winner.rotation = 0;
  impl.winner.scale = 0;
  for (std::size_t scale = 0; scale < impl.reference_grids.size(); ++scale) impl.tryScale(scale);
  return impl.apply(correspondences);
}

}  // namespace ktgp_orb
