#include "ktgp_orb/growth.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

#include "core/growth/grower.h"
#include "core/growth/reference_frames.h"
#include "core/growth/verdict.h"
#include "core/growth/votes.h"
#include "core/homography/estimate.h"
#include "core/util/options_check.h"
#include "ktgp_orb/knn_matcher.h"

namespace ktgp_orb {
namespace growth {
namespace {

constexpr int kFewestVotes = 2;
constexpr int kDescriptorBits = 8 * kDescriptorBytes;

/// A match that others vote for, in a view of the reference.
struct Seed {
  std::int32_t votes;
  std::int32_t view;  // 0: the reference itself
  std::int32_t pair;  // in that view
};

}  // namespace
}  // namespace growth

using growth::FramePair;
using growth::PlacePair;
using growth::Seed;

struct HomographyGrowth::Impl {
  /// What is known of the target from one view of the reference.
  struct View {
    Eigen::Matrix<double, 2, 3> to_view;
    KnnMatcher knn;
    std::vector<Correspondence> matches;
    std::vector<FramePair> pairs;  // in px of the view
    growth::Votes votes;
  };

  void setReference(const Features& reference, const ReferenceViews* given);
  void vote(View& view, const Features& features, const Features& target,
            const std::vector<Correspondence>& matches);
  void collectSeeds();
  Eigen::Matrix3d firstMap(const Seed& seed);
  Eigen::Vector2d placeOf(const Seed& seed) const;
  bool isExplained(const Seed& seed) const;
  bool tryFrom(const Seed& seed, GrowthResult& result);
  bool store(const Eigen::Matrix3d& map, GrowthResult& result);
  void collect(GrowthResult& result) const;

  GrowthOptions options;
  growth::ReferenceFrames reference;
  growth::LocalMatcher matcher;
  growth::Grower grower;
  growth::Verdict verdict;
  homography::HomographyRefiner refiner;
  homography::Finaliser finaliser;
  homography::FinalHomography final;
  cv::Size image_size;       // of the reference
  std::size_t own_size = 0;  // its keypoints, without those of its views
  std::vector<View> views;
  std::vector<Seed> seeds;
  std::vector<std::int32_t> voters;
  std::vector<PlacePair> near;
  std::vector<Eigen::Matrix3d> tried;  // maps that seeds led to
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
  view.pairs.clear();
  for (const Correspondence& c : matches) {
    if (!c.mutual || c.reference_index < 0) continue;
    view.pairs.push_back(
        {growth::frameOf(features.keypoints[static_cast<std::size_t>(c.reference_index)]),
         growth::frameOf(target.keypoints[static_cast<std::size_t>(c.target_index)])});
  }
  view.votes.count(view.pairs, features.image_size, target.image_size);
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

/// Reference to target, from the seed and its voters.
Eigen::Matrix3d HomographyGrowth::Impl::firstMap(const Seed& seed) {
  constexpr double kReach = 30.0;  // px: what the seed's own direction and size weigh
  View& view = views[static_cast<std::size_t>(seed.view)];
  const auto place = [](const FramePair& pair) {
    return PlacePair{{pair.from.x, pair.from.y}, {pair.to.x, pair.to.y}};
  };
  const FramePair& pair = view.pairs[static_cast<std::size_t>(seed.pair)];
  view.votes.voters(static_cast<std::size_t>(seed.pair), voters);
  near.clear();
  for (const std::int32_t voter : voters) {
    near.push_back(place(view.pairs[static_cast<std::size_t>(voter)]));
  }
  const double scale = std::exp(pair.to.log_size - pair.from.log_size);
  const double c = scale * (pair.from.dx * pair.to.dx + pair.from.dy * pair.to.dy);
  const double s = scale * (pair.from.dx * pair.to.dy - pair.from.dy * pair.to.dx);
  const Eigen::Matrix2d turn = (Eigen::Matrix2d() << c, -s, s, c).finished();
  Eigen::Matrix3d to_view = Eigen::Matrix3d::Identity();
  to_view.topRows<2>() = view.to_view;
  return growth::fitAffineNear(near, place(pair), turn, kReach) * to_view;
}

/// In px of the reference.
Eigen::Vector2d HomographyGrowth::Impl::placeOf(const Seed& seed) const {
  const View& view = views[static_cast<std::size_t>(seed.view)];
  const growth::LocalFrame& frame = view.pairs[static_cast<std::size_t>(seed.pair)].from;
  const Eigen::Vector2d p = Eigen::Vector2d(frame.x, frame.y) - view.to_view.col(2);
  return view.to_view.leftCols<2>().inverse() * p;
}

bool HomographyGrowth::Impl::isExplained(const Seed& seed) const {
  constexpr double kNear = 10.0;  // px
  const growth::LocalFrame& to =
      views[static_cast<std::size_t>(seed.view)].pairs[static_cast<std::size_t>(seed.pair)].to;
  const Eigen::Vector2d from = placeOf(seed);
  return std::any_of(tried.begin(), tried.end(), [&](const Eigen::Matrix3d& map) {
    return reprojectionError(map, from, {to.x, to.y}) < kNear;
  });
}

bool HomographyGrowth::Impl::tryFrom(const Seed& seed, GrowthResult& result) {
  ++result.seeds;
  Eigen::Matrix3d map = firstMap(seed);
  if (!grower.grow(placeOf(seed), reference, matcher, map)) return false;
  tried.push_back(map);
  ++result.judged;
  const growth::Judgement judgement = verdict.judge(
      grower.predictions(), reference, growth::Grower::kFirstRadius, options.seeds, matcher);
  if (result.judged == 1 || judgement.log_false_alarms < result.log_false_alarms) {
    result.support = judgement.support;
    result.by_chance = judgement.by_chance;
    result.log_false_alarms = judgement.log_false_alarms;
  }
  if (!(judgement.log_false_alarms < growth::Verdict::kLogMaxFalseAlarms)) return false;
  return store(map, result);
}

/// The homography of greatest likelihood, and what it rests on. False, and nothing is kept, where
/// it is none that the whole reference could be seen by.
bool HomographyGrowth::Impl::store(const Eigen::Matrix3d& map, GrowthResult& result) {
  collect(result);
  UncertainHomography estimate;
  estimate.homography = map / map(2, 2);
  homography::EvidenceOptions evidence;
  evidence.max_error = growth::Verdict::kRadius;
  result.found =
      refiner.refine(result.pairs.reference, result.pairs.target, image_size, evidence, estimate);
  if (result.found) {
    finaliser.finalise(estimate, result.pairs, image_size, growth::Verdict::kRadius, final);
    result.found = final.trusted;
  }
  if (!result.found) {
    result.pairs.clear();
    result.matches.clear();
    return false;
  }
  result.homography = estimate.homography;
  result.covariance = estimate.covariance;
  result.shared_covariance = estimate.shared_covariance;
  result.plane_deviation = estimate.plane_deviation;
  return true;
}

void HomographyGrowth::Impl::collect(GrowthResult& result) const {
  result.pairs.clear();
  result.matches.clear();
  const auto own = static_cast<std::int32_t>(own_size);  // the keypoints of views follow them
  for (std::size_t i = 0; i < grower.pairs().size(); ++i) {
    const growth::LocalMatch& match = grower.matches()[i];
    result.pairs.reference.push_back(grower.pairs()[i].reference);
    result.pairs.target.push_back(grower.pairs()[i].target);
    result.pairs.quality.push_back(match.distance / double{growth::kDescriptorBits});
    if (match.reference >= own) continue;
    result.matches.push_back(
        {match.reference, match.target, match.distance, growth::kDescriptorBits, Level::guided});
  }
  std::sort(result.matches.begin(), result.matches.end(),
            [](const Correspondence& a, const Correspondence& b) {
              return a.target_index < b.target_index;
            });
}

void GrowthResult::clear() {
  found = false;
  homography.setZero();
  covariance.setZero();
  shared_covariance.setZero();
  plane_deviation = 0.0;
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
                            GrowthResult& result) {
  Impl& impl = *impl_;
  result.clear();
  impl.setReference(reference, views);
  impl.matcher.setTarget(target);
  impl.vote(impl.views[0], reference, target, matches);
  for (std::size_t v = 1; v < impl.views.size(); ++v) {
    auto& view = impl.views[v];
    const Features& features = (*views)[v - 1].features;
    view.knn.matchMutual(features.descriptors, target.descriptors, view.matches);
    impl.vote(view, features, target, view.matches);
  }
  impl.collectSeeds();
  impl.tried.clear();
  for (const Seed& seed : impl.seeds) {
    if (result.seeds == impl.options.seeds) break;
    if (impl.isExplained(seed)) continue;
    if (impl.tryFrom(seed, result)) break;
  }
}

}  // namespace ktgp_orb
