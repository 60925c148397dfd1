#include "ktgp_orb/ktgp_matcher.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <utility>

#include "core/util/keypoint_position.h"

namespace ktgp_orb {
namespace {

/// Fills the statistics of one stage from the return value of `run`, which it times.
template <typename Run>
void timeStage(StageResult& stage, const char* name, std::size_t input, Run run) {
  using Clock = std::chrono::steady_clock;
  const auto start = Clock::now();
  stage.output = run();
  stage.milliseconds = std::chrono::duration<double, std::milli>(Clock::now() - start).count();
  stage.name = name;
  stage.input = input;
}

void nameRefinements(const MatcherOptions& options, MatchResult& result) {
  auto& [guided, aligned] = result.refinements;
  guided = {options.guided.enabled ? "guided" : "", 0, 0, 0.0};
  aligned = {options.alignment.enabled ? "align" : "", 0, 0, 0.0};
}

/// As where there is no homography.
void clearRefinement(MatchResult& result) {
  result.guided.clear();
  std::vector<AlignedPoint> points = std::move(result.alignment.points);  // keep the buffer
  points.clear();
  result.alignment = {};
  result.alignment.points = std::move(points);
  result.homography.setZero();
  result.covariance.setZero();
  result.inliers = 0;
  result.rmse = 0.0;
}

}  // namespace

void MatchResult::surviving(Level level, std::vector<Correspondence>& out) const {
  out.clear();
  for (const Correspondence& c : correspondences) {
    if (c.level >= level) out.push_back(c);
  }
}

const char* toString(FoundBy found_by) {
  switch (found_by) {
    case FoundBy::none:
      return "none";
    case FoundBy::prosac:
      return "prosac";
    case FoundBy::growth:
      return "growth";
  }
  return "unknown";
}

double MatchResult::milliseconds() const {
  double sum = 0.0;
  for (const StageResult& stage : stages) sum += stage.milliseconds;
  for (const StageResult& stage : refinements) sum += stage.milliseconds;
  return sum;
}

void MatchResult::clear(const MatcherOptions& options) {
  status = Status::no_reference;
  search = Search::whole;
  correspondences.clear();
  gms = {};
  prosac.status = Status::no_model;
  prosac.homography.setZero();
  prosac.covariance.setZero();
  prosac.mask.clear();
  prosac.inliers = prosac.distinct_inliers = 0;
  prosac.rmse = 0.0;
  found_by = FoundBy::none;
  growth.clear();
  const char* const names[] = {"knn", "tf", "gms", "prosac"};
  for (std::size_t i = 0; i < stages.size(); ++i) stages[i] = {names[i], 0, 0, 0.0};
  nameRefinements(options, *this);
  clearRefinement(*this);
}

MatcherOptions MatcherOptions::ktgp(DescriptorKind descriptor) {
  MatcherOptions options;
  options.ratio_threshold = ratioThreshold(descriptor);
  return options;
}

MatcherOptions MatcherOptions::robust() {
  MatcherOptions options;
  options.mutual = true;
  options.ratio_threshold = 1.0;
  options.gms.enabled = false;
  options.growth.enabled = true;
  options.guided.enabled = true;
  return options;
}

struct KtgpMatcher::Impl {
  explicit Impl(const MatcherOptions& given)
      : options(given),
        knn(given.knn),
        gms(given.gms),
        prosac(given.prosac),
        growth(given.growth),
        guided(given.guided),
        alignment(given.alignment) {}

  std::size_t findNeighbours(const Features& reference, const Features& target,
                             const MatchHints& hints, MatchResult& result);
  void filterByMotion(const Features& reference, const Features& target, MatchResult& result);
  void estimateHomography(const Features& reference, const Features& target,
                          const std::optional<Eigen::Matrix3d>& initial, MatchResult& result);
  void grow(const Features& reference, const Features& target, const MatchHints& hints,
            MatchResult& result);
  void refine(const Features& reference, const Features& target, MatchResult& result);
  void collectFinal(const MatchResult& result);
  double finalRmse(const Features& reference, const Features& target,
                   const Eigen::Matrix3d& homography) const;

  MatcherOptions options;
  KnnMatcher knn;
  GmsFilter gms;
  ProsacHomography prosac;
  PointPairs pairs;
  HomographyGrowth growth;
  bool growth_has_reference = false;  // that of the last call
  GuidedMatcher guided;
  Alignment alignment;
  std::vector<Correspondence> matches;  // of level ktgp and above
};

KtgpMatcher::KtgpMatcher(const MatcherOptions& options) : impl_(std::make_unique<Impl>(options)) {
  std::vector<Correspondence> none;
  filterByRatio(options.ratio_threshold, none);  // refuses a bad T_w now rather than per frame
}

KtgpMatcher::~KtgpMatcher() = default;
KtgpMatcher::KtgpMatcher(KtgpMatcher&&) noexcept = default;
KtgpMatcher& KtgpMatcher::operator=(KtgpMatcher&&) noexcept = default;

const MatcherOptions& KtgpMatcher::options() const {
  return impl_->options;
}

void KtgpMatcher::match(const Features& reference, const Features& target, MatchResult& result) {
  match(reference, target, MatchHints(), result);
}

void KtgpMatcher::match(const Features& reference, const Features& target, const MatchHints& hints,
                        MatchResult& result) {
  requireValid(reference, "reference");
  requireValid(target, "target");
  requireSameDescriptor(reference, target);
  result.descriptor = target.descriptor;
  Impl& impl = *impl_;
  const MatcherOptions& options = impl.options;
  auto& [knn, tf, gms, prosac] = result.stages;
  auto& correspondences = result.correspondences;

  timeStage(knn, "knn", target.size(),
            [&] { return impl.findNeighbours(reference, target, hints, result); });
  timeStage(tf, "tf", knn.output, [&] {
    return filterByRatio(options.ratio_threshold, correspondences, options.mutual);
  });
  timeStage(gms, "gms", tf.output, [&] {
    impl.filterByMotion(reference, target, result);
    return result.gms.kept;
  });
  timeStage(prosac, "prosac", gms.output, [&] {
    impl.estimateHomography(reference, target, hints.prediction, result);
    return result.prosac.status == Status::ok ? result.prosac.inliers : 0;
  });

  const bool enough = reference.size() >= 2 && !target.empty();
  result.status = enough ? result.prosac.status : Status::too_few_features;
  result.found_by = result.status == Status::ok ? FoundBy::prosac : FoundBy::none;
  impl.grow(reference, target, hints, result);
  impl.refine(reference, target, result);
}

/// Returns how many target features have a neighbour.
std::size_t KtgpMatcher::Impl::findNeighbours(const Features& reference, const Features& target,
                                              const MatchHints& hints, MatchResult& result) {
  const bool near = options.knn.search_radius > 0.0 && hints.prediction && !hints.whole_image;
  result.search = near ? Search::near : Search::whole;
  if (hints.same_reference) knn.keepReference();
  std::vector<Correspondence>& found = result.correspondences;
  if (near) {
    knn.matchNear(reference, target, *hints.prediction, options.mutual, found);
  } else if (options.mutual || options.growth.enabled) {
    knn.matchMutual(reference.descriptors, target.descriptors, found);
  } else {
    knn.match(reference.descriptors, target.descriptors, found);
  }
  return static_cast<std::size_t>(std::count_if(
      found.begin(), found.end(), [](const Correspondence& c) { return c.reference_index >= 0; }));
}

void KtgpMatcher::Impl::filterByMotion(const Features& reference, const Features& target,
                                       MatchResult& result) {
  if (options.gms.enabled) {
    result.gms = gms.filter(reference, target, result.correspondences);
    return;
  }
  result.gms = {};
  for (Correspondence& c : result.correspondences) {
    if (c.level != Level::kt) continue;
    c.level = Level::ktg;
    ++result.gms.kept;
  }
}

void KtgpMatcher::Impl::estimateHomography(const Features& reference, const Features& target,
                                           const std::optional<Eigen::Matrix3d>& initial,
                                           MatchResult& result) {
  pairs.clear();
  for (const Correspondence& c : result.correspondences) {
    if (c.level < Level::ktg) continue;
    pairs.reference.push_back(position(reference, c.reference_index));
    pairs.target.push_back(position(target, c.target_index));
    pairs.quality.push_back(c.ratio());
  }
  prosac.estimate(pairs, reference.image_size, initial, result.prosac);
  if (result.prosac.status != Status::ok) return;
  std::size_t i = 0;
  for (Correspondence& c : result.correspondences) {
    if (c.level >= Level::ktg && result.prosac.mask[i++] != 0) c.level = Level::ktgp;
  }
}

void KtgpMatcher::Impl::grow(const Features& reference, const Features& target,
                             const MatchHints& hints, MatchResult& result) {
  result.growth.clear();
  if (!hints.same_reference) growth_has_reference = false;
  if (!options.growth.enabled || result.status == Status::ok || result.search == Search::near)
    return;
  growth.find(reference, hints.views, target, result.correspondences,
              std::exchange(growth_has_reference, true), result.growth);
  if (!result.growth.found) return;
  result.status = Status::ok;
  result.found_by = FoundBy::growth;
  for (Correspondence& c : result.correspondences) {
    if (!c.mutual || c.reference_index < 0) continue;
    const double error =
        reprojectionError(result.growth.homography, position(reference, c.reference_index),
                          position(target, c.target_index));
    if (error < options.prosac.max_error) c.level = Level::ktgp;
  }
}

void KtgpMatcher::Impl::refine(const Features& reference, const Features& target,
                               MatchResult& result) {
  clearRefinement(result);
  nameRefinements(options, result);
  auto& [guided_stage, align_stage] = result.refinements;
  if (result.status != Status::ok) return;
  const bool grown = result.found_by == FoundBy::growth;
  result.homography = grown ? result.growth.homography : result.prosac.homography;
  result.covariance = grown ? result.growth.covariance : result.prosac.covariance;
  const std::size_t inliers = countAtLeast(result.correspondences, Level::ktgp);
  if (options.guided.enabled) {
    timeStage(guided_stage, "guided", inliers, [&] {
      guided.refine(reference, target, result.correspondences, options.prosac.max_error,
                    result.homography, result.covariance, result.guided);
      return inliers + result.guided.size();
    });
  }
  result.inliers = inliers + result.guided.size();
  collectFinal(result);
  if (options.alignment.enabled) {
    timeStage(align_stage, "align", matches.size(), [&] {
      alignment.align(reference, target, matches, result.homography, result.covariance,
                      result.alignment);
      return result.alignment.points.size();
    });
    result.homography = result.alignment.homography;
    result.covariance = result.alignment.covariance;
  }
  result.rmse = finalRmse(reference, target, result.homography);
}

void KtgpMatcher::Impl::collectFinal(const MatchResult& result) {
  result.surviving(Level::ktgp, matches);
  matches.insert(matches.end(), result.guided.begin(), result.guided.end());
}

double KtgpMatcher::Impl::finalRmse(const Features& reference, const Features& target,
                                    const Eigen::Matrix3d& homography) const {
  double sum = 0.0;
  for (const Correspondence& c : matches) {
    const double error = reprojectionError(homography, position(reference, c.reference_index),
                                           position(target, c.target_index));
    sum += error * error;
  }
  return matches.empty() ? 0.0 : std::sqrt(sum / static_cast<double>(matches.size()));
}

}  // namespace ktgp_orb
