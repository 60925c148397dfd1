#include "ktgp_orb/growth.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>
#include <utility>

#include "growth/alike_pairs.h"
#include "growth/grower.h"
#include "growth/map_fit.h"
#include "growth/reference_frames.h"
#include "growth/shift_votes.h"
#include "growth/single_details.h"
#include "growth/verdict.h"
#include "growth/votes.h"
#include "homography/fit.h"
#include "homography/transform.h"
#include "homography/verdict.h"
#include "ktgp_orb/knn_matcher.h"
#include "util/keypoint_position.h"
#include "util/options_check.h"

namespace ktgp_orb {
namespace growth {
namespace {

constexpr int kFewestVotes = 2;
constexpr int kDescriptorBits = 8 * kDescriptorBytes;

/// A match between the target and a view of the reference, with its number of votes.
struct Seed {
  std::int32_t votes;
  std::int32_t view;  // index of the view; 0 is the reference itself
  std::int32_t pair;  // index of the pair among the pairs of this view
};

/// How the votes for shifts were counted.
struct Counting {
  bool of_alike = false;      // only keypoints of similar size voted (see AlikePairs)
  bool in_reference = false;  // shifts are in px of the reference, not of the target
};

/// Support of a hypothesis by mutual nearest neighbours; see ShiftVotes.
struct Standing {
  /// False if the images differ so much in tilt that nearest neighbours are seldom right.
  bool is_known = false;
  double share = 0.0;
  bool is_rivalled = false;
  bool stands_out = false;
  /// True if the scene repeats itself, so that the details that exist once must decide.
  bool needs_details = false;
  /// See SingleDetails::count; empty unless needed, and if the reference is not repetitive.
  std::optional<SingleDetails::Count> details;
  bool has_votes = false;   ///< more votes than chance gives any shift
  bool is_settled = false;  ///< true if the details that exist once show that it is right
};

/// How much a map stretches the image near a point: the largest and the smallest factor over all
/// directions. ORB's descriptors tolerate a scale factor, and a tilt (`largest` / `smallest`), of
/// about two. Within these limits, the true counterpart of a keypoint can be its nearest neighbour.
struct Stretch {
  static constexpr double kMost = 2.0;
  double largest, smallest;

  double scale() const { return std::sqrt(largest * smallest); }
  bool keepsShape() const { return largest < kMost * smallest; }
  bool keepsScale() const { return largest < kMost && kMost * smallest > 1.0; }
};

/// Returns the stretch of `map` in the middle of `pairs`, the pairs that agree with it.
Stretch stretchAmong(const PointPairs& pairs, const Eigen::Matrix3d& map) {
  const Eigen::Matrix2d local = homography::jacobianByPoint(map, middleOf(pairs.reference));
  const double squares = 0.5 * local.squaredNorm();
  const double root =
      std::sqrt(std::max(squares * squares - std::pow(local.determinant(), 2), 0.0));
  const double largest = std::sqrt(squares + root);
  return {largest, std::abs(local.determinant()) / largest};
}

/// Returns the map that first applies `map` and then moves the resulting points by `shift`, px.
Eigen::Matrix3d moved(const Eigen::Matrix3d& map, const Eigen::Vector2d& shift) {
  Eigen::Matrix3d result = map;
  result.topRows<2>() += shift * map.row(2);
  return result;
}

bool isAccepted(const Grown& grown) {
  return grown.judgement.log_false_alarms < Verdict::kLogMaxFalseAlarms;
}

/// Returns true if the matches are not due to chance, but a shifted copy has nearly as many.
bool isRepeated(const Grown& grown) {
  return !isAccepted(grown) && grown.judgement.log_by_chance < Verdict::kLogMaxFalseAlarms;
}

}  // namespace
}  // namespace growth

using growth::Grown;
using growth::Seed;

struct HomographyGrowth::Impl {
  /// The matches between the target and one view of the reference.
  struct View {
    Eigen::Matrix<double, 2, 3> to_view;
    KnnMatcher knn;
    std::vector<Correspondence> matches;
    growth::Votes votes;  // votes for the matches, with positions in px of the view
  };

  void setReference(const Features& reference, const ReferenceViews* given);
  void vote(View& view, const Features& features, const Features& target,
            const std::vector<Correspondence>& matches);
  void collectSeeds();
  Eigen::Matrix3d firstMap(const Seed& seed);
  Eigen::Vector2d placeOf(const Seed& seed) const;
  bool isExplained(const Seed& seed) const;
  void tryFrom(Eigen::Matrix3d map, const Eigen::Vector2d& centre, GrowthResult& result);
  void tryStart(const GrowthStart& start, GrowthResult& result);
  void judge(const Eigen::Matrix3d& map, GrowthResult& result);
  void sortGrown();
  void growFromRepeats(GrowthResult& result);
  void growFromShifts(GrowthResult& result);
  growth::Counting countShifts(const Grown& hypothesis, const growth::Stretch& stretch);
  bool isBacked(std::size_t i, bool& repeats);
  bool isRival(std::size_t other, std::size_t one);
  void choose(GrowthResult& result);
  static void describe(const growth::Judgement& judgement, GrowthResult& result);
  bool store(const Grown& chosen, GrowthResult& result);

  GrowthOptions options;
  growth::ReferenceFrames reference;
  growth::LocalMatcher matcher;
  growth::Grower grower{growth::kScenePlan};
  growth::Verdict verdict;
  homography::HomographyRefiner refiner;
  homography::HomographyVerdict whole_view;
  // Buffer of whole_view.trusts(): labels (inlier or not) of the pairs of the chosen homography.
  ProsacResult labelled;
  cv::Size image_size;  // size of the reference
  // Number of keypoints of the reference image itself; keypoints of its simulated views are not
  // counted
  std::size_t own_size = 0;
  std::vector<View> views;
  std::vector<Seed> seeds;
  std::vector<std::int32_t> voters;
  growth::Places near, near_in_target;     // positions of the voters of a seed, px
  std::vector<Eigen::Matrix3d> tried;      // results of all growths so far
  std::vector<Grown> grown;                // grown maps; only the first `grown_count` are valid
  std::vector<growth::Standing> standing;  // nearest-neighbour support of each entry of `grown`
  std::size_t grown_count = 0;
  // Index in `grown` of the homography that was found from the given start; past the end if there
  // is none.
  std::size_t start_place = 0;
  std::vector<std::size_t> order;  // indices into `grown`, the most significant homography first
  // Buffer of growFromRepeats(): copy of the best hypothesis' Grown::repeats, because tryFrom() may
  // reallocate `grown`.
  std::vector<cv::Point2f> repeats;
  growth::ShiftVotes shifts;
  growth::SingleDetails details;
  std::vector<growth::ShiftVotes::Peak> peaks;
  PointPairs mutual;  // mutual nearest neighbours of the two images, not of simulated views
  // Arguments of find() while it runs.
  const Features* reference_features = nullptr;
  const Features* target_features = nullptr;
  growth::AlikePairs alike;
  PointPairs alike_pairs;             // buffer of countShifts()
  std::vector<std::uint8_t> covered;  // buffer of growth::contradicts
};

void HomographyGrowth::Impl::setReference(const Features& features, const ReferenceViews* given) {
  image_size = features.image_size;
  own_size = features.size();
  reference.set(features, given);
  const std::size_t count = 1 + (given == nullptr ? 0 : given->size());
  views.resize(count);
  for (std::size_t v = 0; v < count; ++v) {
    views[v].to_view = v == 0 ? Eigen::Matrix<double, 2, 3>::Identity() : (*given)[v - 1].to_view;
  }
}

void HomographyGrowth::Impl::vote(View& view, const Features& features, const Features& target,
                                  const std::vector<Correspondence>& matches) {
  view.votes.clear();
  for (const Correspondence& c : matches) {
    if (!c.mutual || c.reference_index < 0) continue;
    view.votes.add(growth::frameOf(features.keypoints[static_cast<std::size_t>(c.reference_index)]),
                   growth::frameOf(target.keypoints[static_cast<std::size_t>(c.target_index)]));
  }
  view.votes.count(features.image_size, target.image_size);
}

void HomographyGrowth::Impl::collectSeeds() {
  seeds.clear();
  for (std::size_t v = 0; v < views.size(); ++v) {
    const std::vector<std::int32_t>& votes = views[v].votes.votes();
    for (std::size_t i = 0; i < votes.size(); ++i) {
      if (votes[i] < growth::kFewestVotes) continue;
      seeds.push_back({votes[i], static_cast<std::int32_t>(v), static_cast<std::int32_t>(i)});
    }
  }
  std::sort(seeds.begin(), seeds.end(), [](const Seed& a, const Seed& b) {
    if (a.votes != b.votes) return a.votes > b.votes;
    return a.view != b.view ? a.view < b.view : a.pair < b.pair;
  });
}

/// Returns a first guess of the map from reference to target: the affine map that fits the seed and
/// its voters.
Eigen::Matrix3d HomographyGrowth::Impl::firstMap(const Seed& seed) {
  // Parameter `reach` of fitAffineNear(), px: determines how much the seed's own rotation and scale
  // count.
  constexpr double kReach = 30.0;
  const View& view = views[static_cast<std::size_t>(seed.view)];
  const growth::Votes::Similarity& pair = view.votes.pair(seed.pair);
  view.votes.voters(seed.pair, voters);
  near.clear();
  near_in_target.clear();
  for (const std::int32_t number : voters) {
    const growth::Votes::Similarity& voter = view.votes.pair(number);
    near.emplace_back(voter.x, voter.y);
    near_in_target.emplace_back(voter.u, voter.v);
  }
  const double scale = pair.scale;
  const double c = scale * pair.cosine;
  const double s = scale * pair.sine;
  const Eigen::Matrix2d turn = (Eigen::Matrix2d() << c, -s, s, c).finished();
  Eigen::Matrix3d to_view = Eigen::Matrix3d::Identity();
  to_view.topRows<2>() = view.to_view;
  return growth::fitAffineNear(near, near_in_target, {pair.x, pair.y}, {pair.u, pair.v}, turn,
                               kReach) *
         to_view;
}

/// Returns the position of the seed, px of the reference.
Eigen::Vector2d HomographyGrowth::Impl::placeOf(const Seed& seed) const {
  const View& view = views[static_cast<std::size_t>(seed.view)];
  const growth::Votes::Similarity& pair = view.votes.pair(seed.pair);
  const Eigen::Vector2d p = Eigen::Vector2d(pair.x, pair.y) - view.to_view.col(2);
  return view.to_view.leftCols<2>().inverse() * p;
}

bool HomographyGrowth::Impl::isExplained(const Seed& seed) const {
  constexpr double kNear = 10.0;  // px
  const growth::Votes::Similarity& pair =
      views[static_cast<std::size_t>(seed.view)].votes.pair(seed.pair);
  const Eigen::Vector2d from = placeOf(seed);
  return std::any_of(tried.begin(), tried.end(), [&](const Eigen::Matrix3d& map) {
    return reprojectionError(map, from, {pair.u, pair.v}) < kNear;
  });
}

/// Grows `map` and judges the result.
void HomographyGrowth::Impl::tryFrom(Eigen::Matrix3d map, const Eigen::Vector2d& centre,
                                     GrowthResult& result) {
  if (grower.grow(centre, reference, matcher, map)) judge(map, result);
}

void HomographyGrowth::Impl::tryStart(const GrowthStart& start, GrowthResult& result) {
  const bool in_sight = start.homography.row(2).dot(start.centre.homogeneous()) > 0.0;
  Eigen::Matrix3d map = in_sight ? start.homography : Eigen::Matrix3d(-start.homography);
  if (grower.settle(start.centre, growth::kScenePlan.settle_radius, reference, matcher, map))
    judge(map, result);
}

/// Adds `map`, the grower's last result, to `grown` with its significance and its nearest-neighbour
/// support.
void HomographyGrowth::Impl::judge(const Eigen::Matrix3d& map, GrowthResult& result) {
  tried.push_back(map);
  ++result.judged;
  const growth::Judgement judgement = verdict.judge(
      grower.predictions(), reference, growth::kScenePlan.first_radius, options.seeds, matcher);
  if (grown_count == grown.size()) grown.emplace_back();
  Grown& kept = grown[grown_count++];
  kept.map = map;
  kept.judgement = judgement;
  kept.matches = grower.matches();
  kept.pairs = grower.pairs();
  kept.repeats = verdict.repeats();
  kept.grew_from_repeats = false;
  standing.resize(grown.size());
  growth::Standing& stands = standing[grown_count - 1];
  stands = {};
  const growth::Stretch stretch = growth::stretchAmong(kept.pairs, map);
  if (!stretch.keepsShape()) return;
  const bool of_alike = countShifts(kept, stretch).of_alike;
  const bool stands_out = shifts.standsOut();
  stands.is_known = true;
  stands.share = shifts.own().share();
  stands.is_rivalled = shifts.isRivalled() || !shifts.isClear() || (of_alike && !stands_out);
  stands.stands_out = stands_out;
  stands.has_votes = shifts.isEvident();
  stands.needs_details = !of_alike && (shifts.isRepetitive() || growth::isRepeated(kept));
}

/// Counts the votes for shifts of `hypothesis`. If the images differ much in scale, measures the
/// shifts in the image with the lower resolution. For example, a shift by one symbol of a page has
/// the same length everywhere in a scan of the page, but not in a photograph taken close to it.
growth::Counting HomographyGrowth::Impl::countShifts(const Grown& hypothesis,
                                                     const growth::Stretch& stretch) {
  if (stretch.keepsScale()) {
    shifts.count(hypothesis.map, mutual, matcher.imageSize());
    return {};
  }
  alike.find(*reference_features, *target_features, stretch.scale(), alike_pairs);
  const bool in_reference = stretch.scale() > 1.0;
  if (in_reference) {
    std::swap(alike_pairs.reference, alike_pairs.target);
    shifts.count(hypothesis.map.inverse(), alike_pairs, image_size);
  } else {
    shifts.count(hypothesis.map, alike_pairs, matcher.imageSize());
  }
  return {true, in_reference};
}

/// Sorts the hypotheses, the most significant first.
void HomographyGrowth::Impl::sortGrown() {
  order.resize(grown_count);
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    const double of_a = grown[a].judgement.log_false_alarms;
    const double of_b = grown[b].judgement.log_false_alarms;
    return of_a != of_b ? of_a < of_b : a < b;
  });
}

/// Shifts the best hypothesis by each displacement with which the scene repeats itself (see
/// Verdict::repeats), and grows the results. Repeats this with the new best hypothesis, up to three
/// times in total, until the best hypothesis has already been shifted.
void HomographyGrowth::Impl::growFromRepeats(GrowthResult& result) {
  constexpr int kMostTimes = 3;
  for (int i = 0; i < kMostTimes && grown_count > 0; ++i) {
    sortGrown();
    Grown& best = grown[order.front()];
    if (!growth::isAccepted(best) || std::exchange(best.grew_from_repeats, true)) return;
    const Eigen::Vector2d middle = growth::middleOf(best.pairs.reference);
    const Eigen::Matrix3d map = best.map;  // a copy, because tryFrom may reallocate `grown`
    repeats = best.repeats;
    for (const cv::Point2f& shift : repeats) {
      tryFrom(growth::moved(map, {shift.x, shift.y}), middle, result);
    }
  }
}

/// If nearest neighbours also vote for other shifts of the best hypothesis (see ShiftVotes),
/// applies up to four of these shifts and grows each result. This is needed because, in a
/// repetitive scene, a wrong shift has as many matches as the right shift, or even more if it makes
/// the images overlap more.
void HomographyGrowth::Impl::growFromShifts(GrowthResult& result) {
  constexpr std::size_t kMostShifts = 4;
  sortGrown();
  if (order.empty() || !standing[order.front()].is_rivalled) return;
  const Grown& best = grown[order.front()];
  const bool in_reference =
      countShifts(best, growth::stretchAmong(best.pairs, best.map)).in_reference;
  // A copy, because tryFrom may reallocate `grown`.
  const Eigen::Matrix3d map = in_reference ? best.map.inverse() : best.map;
  peaks = shifts.others();
  std::sort(peaks.begin(), peaks.end(), [](const auto& a, const auto& b) {
    return a.share() != b.share() ? a.share() > b.share() : a.votes > b.votes;
  });
  if (peaks.size() > kMostShifts) peaks.resize(kMostShifts);
  for (const growth::ShiftVotes::Peak& peak : peaks) {
    const Eigen::Matrix3d shifted = growth::moved(map, peak.shift);
    if (in_reference) {
      tryFrom(shifted.inverse(), homography::project(shifted, peak.centre), result);
    } else {
      tryFrom(shifted, peak.centre, result);
    }
  }
}

/// Returns true if the votes for shifts and the details that exist once agree with hypothesis `i`.
/// `repeats`: true if another hypothesis has shown that the scene repeats itself.
///
/// If nearest neighbours also vote for another shift of a hypothesis (is_rivalled), the scene
/// repeats itself. Then a hypothesis is accepted only if it clearly has more votes than any shift
/// of it (stands_out, see ShiftVotes). It is not enough that it has no rival: if the images overlap
/// only a little under this hypothesis, its share of votes is computed from few pairs and may be
/// large by chance.
bool HomographyGrowth::Impl::isBacked(std::size_t i, bool& repeats) {
  growth::Standing& stands = standing[i];
  if (stands.needs_details) {
    stands.details = details.count(grown[i].map);
    if (stands.details) {
      stands.is_rivalled = stands.is_rivalled || stands.details->contradict();
      stands.is_settled =
          stands.details->settle() && stands.has_votes && !growth::isRepeated(grown[i]);
    }
    if (stands.is_settled) return true;
  }
  repeats |= stands.is_rivalled || growth::isRepeated(grown[i]);
  return !stands.is_rivalled && (!repeats || stands.stands_out);
}

/// Returns true if `other` could be right instead of `one`. It must contradict `one` and, if the
/// shares of nearest-neighbour votes are known for both, have more than half the share of `one`.
/// Votes for what both agree on do not count: a distorted copy of `one` has many of its votes. If
/// single details decide for `one`, `other` must also find more than half as large a share of them.
bool HomographyGrowth::Impl::isRival(std::size_t other, std::size_t one) {
  constexpr double kClear = 2.0;
  if (other == one) return false;
  if (standing[other].is_known && standing[one].is_known) {
    const double own = 1.0 - growth::agreement(grown[other], grown[one]);
    if (!(kClear * own * standing[other].share > standing[one].share)) return false;
  }
  if (!growth::contradicts(grown[other], grown[one], matcher.imageSize(), covered)) return false;
  if (!standing[one].is_settled) return true;
  const auto found = details.count(grown[other].map);
  return !found || kClear * found->share() > standing[one].details->share();
}

/// Chooses the best hypothesis, unless chance explains it or a contradicting hypothesis is nearly
/// as good. Prefers the start (the homography that the caller gave), because it was also found by
/// another method. The start is chosen if the best hypothesis has no more matches than the start,
/// if fewer than 10^-4 homographies as good as the start are expected by chance, and if nearest
/// neighbours do not vote for another shift.
void HomographyGrowth::Impl::choose(GrowthResult& result) {
  constexpr double kLogMaxOfStart = -4.0;
  sortGrown();
  if (order.empty()) return;
  const growth::Judgement& judgement = grown[order.front()].judgement;
  describe(judgement, result);
  if (start_place < grown_count) {
    const growth::Judgement& of_start = grown[start_place].judgement;
    bool repeats = false;
    if (of_start.log_false_alarms < kLogMaxOfStart && of_start.matched >= judgement.matched &&
        isBacked(start_place, repeats)) {
      store(grown[start_place], result);
      return;
    }
  }
  bool repeats = false, refused_otherwise = false;
  for (const std::size_t i : order) {
    if (!growth::isAccepted(grown[i]) && !growth::isRepeated(grown[i])) continue;
    if (!isBacked(i, repeats)) continue;
    const auto is_rival = [&](std::size_t other) { return isRival(other, i); };
    result.is_repetitive = std::any_of(order.begin(), order.end(), is_rival);
    if (result.is_repetitive || store(grown[i], result)) return;
    refused_otherwise = true;
  }
  result.is_repetitive = repeats && !refused_otherwise;
}

void HomographyGrowth::Impl::describe(const growth::Judgement& judgement, GrowthResult& result) {
  result.support = judgement.support;
  result.by_chance = judgement.by_chance;
  result.log_false_alarms = judgement.log_false_alarms;
}

/// Refines the chosen homography by maximum likelihood and stores it with its pairs. Returns false,
/// without a result, if the fit fails or `whole_view` does not trust the homography.
bool HomographyGrowth::Impl::store(const Grown& chosen, GrowthResult& result) {
  result.pairs = chosen.pairs;
  UncertainHomography estimate{chosen.map / chosen.map(2, 2)};
  const auto evidence = homography::evidenceOfKeypoints(growth::Verdict::kRadius, true);
  result.found =
      refiner.refine(result.pairs.reference, result.pairs.target, image_size, evidence, estimate) &&
      whole_view.trusts(estimate, result.pairs, image_size, growth::Verdict::kRadius, labelled);
  if (!result.found) {
    result.pairs.clear();
    return false;
  }
  describe(chosen.judgement, result);
  // A shifted copy has nearly as many matches, but other evidence has refused it.
  if (growth::isRepeated(chosen)) result.log_false_alarms = chosen.judgement.log_by_chance;
  result.answer = estimate;
  // Keypoints with the index own_size or higher belong to simulated views.
  const auto own = static_cast<std::int32_t>(own_size);
  for (const growth::LocalMatch& match : chosen.matches) {
    if (match.reference >= own) continue;
    result.matches.push_back(
        {match.reference, match.target, match.distance, growth::kDescriptorBits, Level::guided});
  }
  std::sort(result.matches.begin(), result.matches.end(),
            [](const Correspondence& a, const Correspondence& b) {
              return a.target_index < b.target_index;
            });
  return true;
}

void GrowthResult::clear() {
  found = is_repetitive = false;
  answer = {};
  pairs.clear();
  matches.clear();
  support = 0;
  by_chance = log_false_alarms = 0.0;
  seeds = judged = 0;
}

HomographyGrowth::HomographyGrowth(const GrowthOptions& options) : impl_(std::make_unique<Impl>()) {
  util::requireInRange("growth_seeds", options.seeds, 1, 10000);
  util::requireInRange("views", options.views, 0, 13);
  impl_->options = options;
}

HomographyGrowth::~HomographyGrowth() = default;
HomographyGrowth::HomographyGrowth(HomographyGrowth&&) noexcept = default;
HomographyGrowth& HomographyGrowth::operator=(HomographyGrowth&&) noexcept = default;

const GrowthOptions& HomographyGrowth::options() const {
  return impl_->options;
}

void HomographyGrowth::find(const Features& reference, const ReferenceViews* views,
                            const Features& target, const std::vector<Correspondence>& matches,
                            const std::optional<GrowthStart>& start, GrowthResult& result) {
  requireSameDescriptor(reference, target);
  Impl& impl = *impl_;
  result.clear();
  impl.setReference(reference, views);
  impl.matcher.setTarget(target);
  impl.reference_features = &reference;
  impl.target_features = &target;
  impl.vote(impl.views[0], reference, target, matches);
  for (std::size_t v = 1; v < impl.views.size(); ++v) {
    auto& view = impl.views[v];
    const Features& features = (*views)[v - 1].features;
    view.knn.matchMutual(features.descriptors, target.descriptors, view.matches);
    impl.vote(view, features, target, view.matches);
  }
  impl.details.setFrames(reference, target);
  impl.collectSeeds();
  impl.mutual.clear();
  for (const Correspondence& c : matches) {
    if (!c.mutual || c.reference_index < 0) continue;
    impl.mutual.add(util::position(reference, c.reference_index),
                    util::position(target, c.target_index), c.ratio());
  }
  impl.tried.clear();
  impl.grown_count = 0;
  if (start) impl.tryStart(*start, result);
  impl.start_place = impl.grown_count > 0 ? 0 : std::numeric_limits<std::size_t>::max();
  for (const Seed& seed : impl.seeds) {
    if (result.seeds == impl.options.seeds) break;
    if (impl.isExplained(seed)) continue;
    ++result.seeds;
    impl.tryFrom(impl.firstMap(seed), impl.placeOf(seed), result);
  }
  impl.growFromRepeats(result);
  impl.growFromShifts(result);
  impl.choose(result);
}

}  // namespace ktgp_orb
