#include "ktgp_orb/ktgp_matcher.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <optional>
#include <utility>

#include "core/growth/verdict.h"
#include "core/homography/transform.h"
#include "core/homography/verdict.h"
#include "core/util/keypoint_position.h"
#include "core/util/milliseconds.h"
#include "core/util/names.h"
#include "core/util/reset_keeping.h"

namespace ktgp_orb {
namespace {

using util::position;

/// Fills the statistics of one stage from the return value of `run`, which it times and returns.
template <typename Run>
std::size_t timeStage(MatchResult& result, std::string_view name, std::size_t input, Run run) {
  const auto start = std::chrono::steady_clock::now();
  const std::size_t output = run();
  const double time = util::millisecondsSince(start);
  for (StageResult& stage : result.stages) {
    if (stage.name == name) stage = {stage.name, input, output, time};
  }
  return output;
}

bool hasTwoView(const MatcherOptions& options) {
  return options.geometry != GeometryModel::homography;
}

/// None of them has run.
void nameStages(const MatcherOptions& options, MatchResult& result) {
  result.stages = {{"knn"}, {"tf"}, {"gms"}, {"prosac"}};
  const std::pair<const char*, bool> others[] = {{"growth", options.growth.enabled},
                                                 {"guided", options.guided.enabled},
                                                 {"align", options.alignment.enabled},
                                                 {"two_view", hasTwoView(options)}};
  for (const auto& [name, is_on] : others) {
    if (is_on) result.stages.push_back({name});
  }
}

AlignmentOptions alignmentOptions(const MatcherOptions& options) {
  AlignmentOptions alignment = options.alignment;
  alignment.max_error = options.prosac.max_error;
  return alignment;
}

TwoViewOptions twoViewOptions(const MatcherOptions& options) {
  TwoViewOptions two_view = options.two_view;
  two_view.max_error = options.prosac.max_error;
  two_view.max_iterations = options.prosac.max_iterations;
  two_view.confidence = options.prosac.confidence;
  two_view.seed = options.prosac.seed;
  two_view.homography = options.geometry != GeometryModel::epipolar;
  two_view.alignment = options.alignment.enabled;
  return two_view;
}

/// Who looks for hard pairs has scenes that are not quite planes.
GuidedOptions guidedOptions(const MatcherOptions& options) {
  GuidedOptions guided = options.guided;
  guided.by_cell |= options.growth.enabled;
  return guided;
}

/// Resets the results of the stages after the homography.
void clearRefinement(MatchResult& result) {
  result.guided.clear();
  util::resetKeeping(&AlignmentResult::points, result.alignment);
  result.answer = {};
  result.inliers = 0;
  result.rmse = 0.0;
}

/// As if no homography had been looked for.
void clearHomography(MatchResult& result) {
  result.stages[3] = {"prosac", result.gms.kept, 0, 0.0};
  util::resetKeeping(&ProsacResult::mask, result.prosac);
  result.found_by = FoundBy::none;
  result.growth.clear();
  clearRefinement(result);
}

/// Keeps the buffers.
void clearTwoView(MatchResult& result) {
  result.geometry = Geometry::none;
  TwoViewMatches& two_view = result.two_view;
  two_view.pairs.clear();
  two_view.match.clear();
  two_view.aligned.clear();
  two_view.levels.clear();
  util::resetKeeping(&TwoView::mask, two_view.view);
}

}  // namespace

void MatchResult::surviving(Level level, std::vector<Correspondence>& out) const {
  out.clear();
  for (const Correspondence& c : correspondences) {
    if (c.level >= level) out.push_back(c);
  }
}

const char* toString(FoundBy found_by) {
  return util::nameOf<FoundBy::growth>(found_by, {"none", "prosac", "growth"});
}

const StageResult* MatchResult::stage(std::string_view name) const {
  for (const StageResult& one : stages) {
    if (one.name == name) return &one;
  }
  return nullptr;
}

double MatchResult::milliseconds() const {
  double sum = 0.0;
  for (const StageResult& stage : stages) sum += stage.milliseconds;
  return sum;
}

void MatchResult::clear(const MatcherOptions& options) {
  status = Status::no_reference;
  search = Search::whole;
  correspondences.clear();
  gms = {};
  nameStages(options, *this);
  clearHomography(*this);
  clearTwoView(*this);
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

MatcherOptions MatcherOptions::slam() {
  MatcherOptions options;
  options.mutual = true;
  options.ratio_threshold = 1.0;
  options.gms.enabled = false;
  options.geometry = GeometryModel::automatic;
  options.two_view = TwoViewOptions::realCameras();
  return options;
}

struct KtgpMatcher::Impl {
  explicit Impl(const MatcherOptions& given)
      : options(given),
        knn(given.knn),
        gms(given.gms),
        prosac(given.prosac),
        growth(given.growth),
        guided(guidedOptions(given)),
        alignment(alignmentOptions(given)),
        two_view(twoViewOptions(given)) {}

  std::size_t findNeighbours(const Features& reference, const Features& target,
                             const MatchHints& hints, MatchResult& result);
  void estimateHomography(const Features& reference, const Features& target,
                          const std::optional<Eigen::Matrix3d>& initial, MatchResult& result);
  std::optional<GrowthStart> doubtful(const MatchResult& result) const;
  void grow(const Features& reference, const Features& target, const ReferenceViews* views,
            MatchResult& result);
  bool findEpipolar(const Features& reference, const Features& target, const MatchHints& hints,
                    MatchResult& result);
  void findHomography(const Features& reference, const Features& target, const MatchHints& hints,
                      MatchResult& result);
  void refine(const Features& reference, const Features& target, MatchResult& result);
  void align(const UncertainHomography& before, const Features& reference, const Features& target,
             MatchResult& result);
  bool adopt(const UncertainHomography& candidate, const Features& reference,
             const Features& target, MatchResult& result);
  void publish(const ProsacResult& found, const Features& reference, const Features& target,
               MatchResult& result);

  MatcherOptions options;
  KnnMatcher knn;
  GmsFilter gms;
  ProsacHomography prosac;
  PointPairs pairs;
  HomographyGrowth growth;
  GuidedMatcher guided;
  Alignment alignment;
  TwoViewMatcher two_view;
  homography::HomographyVerdict verdict;
  ProsacResult labelled;                       // a candidate that PROSAC did not find
  std::vector<Correspondence> guided_matches;  // all matches of guided matching
  std::vector<std::uint8_t> taken;             // target keypoints that are inliers
  std::vector<Correspondence> matches;         // to align
};

KtgpMatcher::KtgpMatcher(const MatcherOptions& options) : impl_(std::make_unique<Impl>(options)) {
  if (options.ratio_threshold) requireRatioThreshold(*options.ratio_threshold);
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
  auto& correspondences = result.correspondences;

  nameStages(options, result);
  std::size_t left = timeStage(result, "knn", target.size(), [&] {
    return impl.findNeighbours(reference, target, hints, result);
  });
  left = timeStage(result, "tf", left, [&] {
    const double usual = ratioThreshold(target.descriptor);
    return filterByRatio(options.ratio_threshold.value_or(usual), correspondences, options.mutual);
  });
  timeStage(result, "gms", left, [&] {
    result.gms = impl.gms.filter(reference, target, correspondences);
    return result.gms.kept;
  });
  clearTwoView(result);
  if (impl.findEpipolar(reference, target, hints, result)) return;
  impl.findHomography(reference, target, hints, result);
}

/// The two-view geometry, where it is wanted. True: it is the result, since the scene has depth or
/// no homography is wanted.
bool KtgpMatcher::Impl::findEpipolar(const Features& reference, const Features& target,
                                     const MatchHints& hints, MatchResult& result) {
  if (!hasTwoView(options)) return false;
  TwoViewMatches& found = result.two_view;
  timeStage(result, "two_view", result.gms.kept, [&] {
    TwoViewInput input;
    input.reference_camera = hints.reference_camera;
    input.target_camera = hints.target_camera;
    input.reference_lens = hints.reference_lens;
    input.target_lens = hints.target_lens;
    input.prediction = hints.motion;
    two_view.estimate(reference, target, result.correspondences, input, found);
    return found.view.inliers;
  });
  const bool epipolar = found.view.geometry == Geometry::epipolar;
  if (options.geometry == GeometryModel::automatic && !epipolar) return false;
  clearHomography(result);
  const bool enough = reference.size() >= 2 && !target.empty();
  result.status = enough ? found.view.status : Status::too_few_features;
  if (!epipolar) return true;
  result.geometry = Geometry::epipolar;
  result.status = Status::model_rejected;
  result.inliers = found.view.inliers;
  result.rmse = found.view.rmse;
  for (std::size_t i = 0; i < result.correspondences.size(); ++i) {
    result.correspondences[i].level = found.levels[i];
  }
  return true;
}

/// PROSAC and what follows it.
void KtgpMatcher::Impl::findHomography(const Features& reference, const Features& target,
                                       const MatchHints& hints, MatchResult& result) {
  std::optional<Eigen::Matrix3d> initial = hints.prediction;
  TwoView& view = result.two_view.view;
  if (view.geometry != Geometry::none) initial = view.homography;
  timeStage(result, "prosac", result.gms.kept, [&] {
    estimateHomography(reference, target, initial, result);
    return result.prosac.status == Status::ok ? result.prosac.inliers : 0;
  });
  const bool enough = reference.size() >= 2 && !target.empty();
  result.status = enough ? result.prosac.status : Status::too_few_features;
  result.found_by = result.status == Status::ok ? FoundBy::prosac : FoundBy::none;
  grow(reference, target, hints.views, result);
  refine(reference, target, result);
  if (result.status != Status::ok) {  // the keypoints do not show what `view` may have found
    clearTwoView(result);
    return;
  }
  result.geometry = view.geometry == Geometry::rotation ? Geometry::rotation : Geometry::plane;
  view.geometry = result.geometry;
}

/// Returns the number of target features with a neighbour.
std::size_t KtgpMatcher::Impl::findNeighbours(const Features& reference, const Features& target,
                                              const MatchHints& hints, MatchResult& result) {
  const bool near = options.knn.search_radius > 0.0 && hints.prediction && !hints.whole_image;
  result.search = near ? Search::near : Search::whole;
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

void KtgpMatcher::Impl::estimateHomography(const Features& reference, const Features& target,
                                           const std::optional<Eigen::Matrix3d>& initial,
                                           MatchResult& result) {
  pairs.clear();
  pairs.rounding = util::kKeypointRounding;
  for (const Correspondence& c : result.correspondences) {
    if (c.level < Level::ktg) continue;
    pairs.add(position(reference, c.reference_index), position(target, c.target_index), c.ratio());
  }
  prosac.estimate(pairs, reference.image_size, initial, result.prosac);
}

/// PROSAC's homography, if so few matches agree with it that something which repeats itself, such
/// as the windows of a house, may have misled it. Empty otherwise.
std::optional<GrowthStart> KtgpMatcher::Impl::doubtful(const MatchResult& result) const {
  constexpr std::size_t kFew = 50;
  constexpr std::size_t kOneIn = 8;  // of the matches
  const std::size_t inliers = result.prosac.inliers;
  if (result.status != Status::ok || inliers >= kFew || kOneIn * inliers >= pairs.size()) {
    return std::nullopt;
  }
  GrowthStart start;
  start.homography = result.prosac.answer.homography;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (result.prosac.mask[i] != 0) start.centre += pairs.reference[i];
  }
  start.centre /= static_cast<double>(inliers);
  return start;
}

/// Called after PROSAC; grows a homography if PROSAC found none in the whole image. A doubtful one
/// must be as significant as the grown ones, and not contradicted by them.
void KtgpMatcher::Impl::grow(const Features& reference, const Features& target,
                             const ReferenceViews* views, MatchResult& result) {
  result.growth.clear();
  if (!options.growth.enabled) return;
  const std::optional<GrowthStart> start = doubtful(result);
  if (result.search != Search::whole) {
    // Growth needs the matches of the whole image: see MatchHints::prediction.
    if (start) {
      result.status = Status::model_rejected;
      result.found_by = FoundBy::none;
    }
    return;
  }
  if (result.status == Status::ok && !start) return;
  const auto is_mutual = [](const Correspondence& c) { return c.mutual; };
  const auto mutual =
      std::count_if(result.correspondences.begin(), result.correspondences.end(), is_mutual);
  timeStage(result, "growth", static_cast<std::size_t>(mutual), [&] {
    growth.find(reference, views, target, result.correspondences, start, result.growth);
    return result.growth.pairs.size();
  });
  if (start) result.status = Status::model_rejected;
  if (result.growth.found) result.status = Status::ok;
  result.found_by = result.growth.found ? FoundBy::growth : FoundBy::none;
}

/// Guided matching and alignment, if they are enabled. adopt() derives the results for the new
/// homography.
void KtgpMatcher::Impl::refine(const Features& reference, const Features& target,
                               MatchResult& result) {
  clearRefinement(result);
  guided_matches.clear();
  if (result.status != Status::ok) return;
  const bool grown = result.found_by == FoundBy::growth;
  UncertainHomography answer = grown ? result.growth.answer : result.prosac.answer;
  if (grown) guided_matches = result.growth.matches;
  if (!grown) {
    publish(result.prosac, reference, target, result);
  } else if (!adopt(answer, reference, target, result)) {
    result.status = Status::model_rejected;
    result.found_by = FoundBy::none;
    return;
  }
  if (options.guided.enabled) {
    timeStage(result, "guided", result.inliers, [&] {
      UncertainHomography candidate = answer;
      guided.refine(reference, target, options.prosac.max_error, candidate, guided_matches);
      if (adopt(candidate, reference, target, result)) answer = candidate;
      return result.inliers;
    });
  }
  if (options.alignment.enabled) {
    result.surviving(Level::ktgp, matches);
    matches.insert(matches.end(), result.guided.begin(), result.guided.end());
    timeStage(result, "align", matches.size(), [&] {
      align(answer, reference, target, result);
      return result.alignment.points.size();
    });
  }
}

void KtgpMatcher::Impl::align(const UncertainHomography& before, const Features& reference,
                              const Features& target, MatchResult& result) {
  AlignmentResult& aligned = result.alignment;
  alignment.align(reference, target, matches, before, aligned);
  if (aligned.status != AlignmentStatus::ok) return;
  if (adopt(aligned.answer, reference, target, result)) return;
  aligned.status = AlignmentStatus::not_better;
  aligned.answer = before;
}

/// Makes `candidate` the result, with mask, inliers and RMSE derived from it. Returns false,
/// without any change, if the verdict on it is bad.
///
/// A grown homography has the verdict of the growth, since the few right ones among the matches
/// would not give one. A homography derived from it must still agree with the pairs of the growth.
bool KtgpMatcher::Impl::adopt(const UncertainHomography& candidate, const Features& reference,
                              const Features& target, MatchResult& result) {
  const bool grown = result.found_by == FoundBy::growth;
  if (!verdict.trusts(candidate.homography, grown ? result.growth.pairs : pairs,
                      reference.image_size,
                      grown ? growth::Verdict::kRadius : options.prosac.max_error)) {
    return false;
  }
  homography::label(candidate, pairs, options.prosac.max_error, labelled);
  publish(labelled, reference, target, result);
  return true;
}

/// Sets the result and everything that belongs to it: levels, the guided matches that agree,
/// inliers and RMSE. `found`: the answer, labelled with the pairs that passed GMS.
void KtgpMatcher::Impl::publish(const ProsacResult& found, const Features& reference,
                                const Features& target, MatchResult& result) {
  result.answer = found.answer;
  taken.assign(target.size(), 0);
  std::size_t i = 0;
  for (Correspondence& c : result.correspondences) {
    if (c.level < Level::ktg) continue;
    const bool inlier = found.mask[i++] != 0;
    c.level = inlier ? Level::ktgp : Level::ktg;
    if (inlier) taken[static_cast<std::size_t>(c.target_index)] = 1;
  }
  const double rmse = found.rmse;
  double squares = rmse * rmse * static_cast<double>(found.inliers);
  result.guided.clear();
  for (const Correspondence& c : guided_matches) {
    if (taken[static_cast<std::size_t>(c.target_index)] != 0) continue;
    const double error =
        homography::errorOf(result.answer.homography, position(reference, c.reference_index),
                            position(target, c.target_index));
    if (!(error < options.prosac.max_error)) continue;
    result.guided.push_back(c);
    squares += error * error;
  }
  result.inliers = found.inliers + result.guided.size();
  result.rmse =
      result.guided.empty() ? rmse : std::sqrt(squares / static_cast<double>(result.inliers));
}

}  // namespace ktgp_orb
