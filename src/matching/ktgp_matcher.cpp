#include "ktgp_orb/ktgp_matcher.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <optional>

#include "growth/shift_votes.h"
#include "growth/single_details.h"
#include "growth/verdict.h"
#include "homography/transform.h"
#include "homography/verdict.h"
#include "matching/neighbours.h"
#include "matching/standing/standing.h"
#include "util/keypoint_position.h"
#include "util/milliseconds.h"
#include "util/names.h"
#include "util/reset_keeping.h"

namespace ktgp_orb {
namespace {

using util::position;

bool hasTwoView(const MatcherOptions& options) {
  return options.geometry != GeometryModel::homography;
}

TwoViewOptions twoViewOptions(const MatcherOptions& options) {
  TwoViewOptions two_view;
  two_view.shared_errors = options.shared_errors;
  two_view.max_error = options.prosac.max_error;
  two_view.max_iterations = options.prosac.max_iterations;
  two_view.confidence = options.prosac.confidence;
  two_view.seed = options.prosac.seed;
  two_view.homography = options.geometry != GeometryModel::epipolar;
  two_view.alignment = options.alignment.enabled;
  return two_view;
}

void clearTwoView(MatchResult& result) {
  result.geometry = Geometry::none;
  TwoViewMatches& two_view = result.two_view;
  two_view.pairs.clear();
  two_view.match.clear();
  two_view.aligned.clear();
  two_view.levels.clear();
  util::resetKeeping(&TwoView::mask, two_view.view);
}

/// Removes the geometry from the result, but keeps the memory of its buffers.
void clearGeometry(MatchResult& result) {
  util::resetKeeping(&ProsacResult::mask, result.prosac);
  result.found_by = FoundBy::none;
  result.growth.clear();
  result.guided.clear();
  util::resetKeeping(&AlignmentResult::points, result.alignment);
  result.answer = {};
  result.inliers = 0;
  result.rmse = 0.0;
  result.still = 0;
  clearTwoView(result);
}

void reject(MatchResult& result) {
  result.status = Status::model_rejected;
  result.found_by = FoundBy::none;
}

/// The stages of a matcher. Each stage reads what the previous stages left in the result.
class Chain {
 public:
  explicit Chain(const MatcherOptions& given)
      : options(given),
        knn_(given.knn),
        gms_(given.gms),
        prosac_(given.prosac),
        growth_(given.growth),
        guided_(given.guided),
        alignment_(given.alignment, given.prosac.max_error),
        two_view_(twoViewOptions(given)) {}

  /// Lists the stages that `options` switch on. None of them has run yet.
  static void nameStages(const MatcherOptions& options, MatchResult& result);
  void run(const Features& reference, const Features& target, const MatchHints& hints,
           MatchResult& result);

  const MatcherOptions options;

 private:
  /// Input and results for one pair of frames; all stages share them.
  struct Context {
    const Features& reference;
    const Features& target;
    const MatchHints& hints;
    MatchResult& result;
    /// False if an epipolar geometry explains the matches, or if the options want no homography.
    bool wants_homography = true;
    /// PROSAC's homography, if it is doubtful and growth must judge it.
    std::optional<GrowthStart> doubt{};
    bool haveEnough() const { return reference.size() >= 2 && !target.empty(); }
  };
  struct Stage {
    StageId id;
    bool (*is_on)(const MatcherOptions& options);
    /// Runs the stage, and sets `input` and `output` of its StageResult. Returns false if this pair
    /// does not need the stage.
    bool (Chain::*run)(Context& context, StageResult& stage);
  };
  static const Stage kStages[];  // all stages, in the order in which they run
  static const Stage* const kProsacStage;

  void runStages(const Stage* first, Context& context);
  bool sceneMoves(Context& context);

  bool runKnn(Context& context, StageResult& stage);
  bool runRatio(Context& context, StageResult& stage);
  bool runGms(Context& context, StageResult& stage);
  bool runTwoView(Context& context, StageResult& stage);
  bool runProsac(Context& context, StageResult& stage);
  bool runGrowth(Context& context, StageResult& stage);
  bool runGuided(Context& context, StageResult& stage);
  bool runAlignment(Context& context, StageResult& stage);

  std::optional<GrowthStart> doubtful(const Context& context);
  bool agreesWithDetails(const Context& context);
  bool adopt(const UncertainHomography& candidate, Context& context);
  void setAnswer(const ProsacResult& found, Context& context);

  KnnMatcher knn_;
  GmsFilter gms_;
  ProsacHomography prosac_;
  HomographyGrowth growth_;
  GuidedMatcher guided_;
  Alignment alignment_;
  TwoViewMatcher two_view_;
  homography::HomographyVerdict verdict_;
  growth::ShiftVotes shifts_;
  matching::Neighbours neighbours_;
  growth::SingleDetails details_;
  matching::Standing standing_;
  PointPairs pairs_;       // the matches that passed GMS
  ProsacResult labelled_;  // labels (inlier or not) of the pairs for a candidate homography
  std::vector<Correspondence> guided_matches_;  // all matches of guided matching or growth
  std::vector<std::uint8_t> taken_;  // for each target keypoint, 1 if it is an inlier of the answer
  std::vector<Correspondence> matches_;  // matches from which the alignment starts
};

bool always(const MatcherOptions& /*options*/) {
  return true;
}

const Chain::Stage Chain::kStages[] = {
    {StageId::knn, always, &Chain::runKnn},
    {StageId::tf, always, &Chain::runRatio},
    {StageId::gms, always, &Chain::runGms},
    {StageId::two_view, hasTwoView, &Chain::runTwoView},
    {StageId::prosac, always, &Chain::runProsac},
    {StageId::growth, [](const MatcherOptions& o) { return o.growth.enabled; }, &Chain::runGrowth},
    {StageId::guided, [](const MatcherOptions& o) { return o.guided.enabled; }, &Chain::runGuided},
    {StageId::align, [](const MatcherOptions& o) { return o.alignment.enabled; },
     &Chain::runAlignment},
};
const Chain::Stage* const Chain::kProsacStage = kStages + 4;

void Chain::nameStages(const MatcherOptions& options, MatchResult& result) {
  auto& stages = result.stages;
  stages.clear();
  for (const Stage& stage : kStages) {
    if (stage.is_on(options)) stages.push_back({stage.id});
  }
  std::sort(stages.begin(), stages.end(),
            [](const StageResult& a, const StageResult& b) { return a.id < b.id; });
}

void Chain::run(const Features& reference, const Features& target, const MatchHints& hints,
                MatchResult& result) {
  nameStages(options, result);
  clearGeometry(result);
  guided_matches_.clear();
  Context context{reference, target, hints, result};
  runStages(kStages, context);
  if (sceneMoves(context)) {
    clearGeometry(result);
    guided_matches_.clear();
    context.doubt.reset();
    runStages(kProsacStage, context);
  }
  if (result.homographyStatus() == Status::ok) {
    result.still = matching::Standing::count(result.answer.homography, reference, target,
                                             result.correspondences);
  }
  if (!context.wants_homography) return;
  if (result.status != Status::ok) {  // the keypoints do not confirm the two-view geometry
    clearTwoView(result);
    return;
  }
  const bool turned = result.two_view.view.geometry == Geometry::rotation;
  result.geometry = turned ? Geometry::rotation : Geometry::plane;
}

/// Runs `first` and all stages after it. Adds their times to those of an earlier run.
void Chain::runStages(const Stage* first, Context& context) {
  std::vector<StageResult>& stages = context.result.stages;
  for (const Stage* stage = first; stage != std::end(kStages); ++stage) {
    if (!stage->is_on(options)) continue;
    const auto start = std::chrono::steady_clock::now();
    StageResult& listed = *std::find_if(stages.begin(), stages.end(),
                                        [&](const StageResult& s) { return s.id == stage->id; });
    if ((this->*stage->run)(context, listed)) listed.milliseconds += util::millisecondsSince(start);
  }
}

/// Returns true if matches that stand still, such as hot pixels, may determine the homography or
/// bend it, while other matches agree that the scene moves. In this case, the matches that stand
/// still do not count any more.
bool Chain::sceneMoves(Context& context) {
  using matching::Standing;
  MatchResult& result = context.result;
  if (hasTwoView(options) || result.status != Status::ok) return false;
  if (!standing_.collect(context.reference, context.target, result.correspondences)) return false;
  if (!standing_.mayMislead(result.answer.homography, options.prosac.max_error)) return false;
  prosac_.estimate(standing_.moving(), context.reference.image_size, std::nullopt, labelled_);
  if (labelled_.status != Status::ok || !standing_.isScene(labelled_)) return false;
  Standing::lower(labelled_.answer.homography, context.reference, context.target,
                  result.correspondences);
  return true;
}

/// The output of this stage is the number of target features that have a neighbour.
bool Chain::runKnn(Context& context, StageResult& stage) {
  const Features& reference = context.reference;
  const Features& target = context.target;
  const MatchHints& hints = context.hints;
  const bool near = options.knn.search_radius > 0.0 && hints.prediction && !hints.whole_image;
  context.result.search = near ? Search::near : Search::whole;
  std::vector<Correspondence>& found = context.result.correspondences;
  if (near) {
    knn_.matchNear(reference, target, *hints.prediction, options.mutual, found);
  } else if (options.mutual || options.growth.enabled) {
    knn_.matchMutual(reference.descriptors, target.descriptors, found);
  } else {
    knn_.match(reference.descriptors, target.descriptors, found);
  }
  stage.input = target.size();
  stage.output = static_cast<std::size_t>(std::count_if(
      found.begin(), found.end(), [](const Correspondence& c) { return c.reference_index >= 0; }));
  return true;
}

bool Chain::runRatio(Context& context, StageResult& stage) {
  const double usual = ratioThreshold(context.target.descriptor);
  stage.input = context.result.stage(StageId::knn)->output;
  stage.output = filterByRatio(options.ratio_threshold.value_or(usual),
                               context.result.correspondences, options.mutual);
  return true;
}

/// Without GMS, the two-view geometry needs another filter: in difficult scenes, nine of ten
/// matches are wrong, and then neither the alignment nor PROSAC works. With growth, this filter is
/// off: growth has votes of its own, and doubtful() compares the inliers with all matches.
bool Chain::runGms(Context& context, StageResult& stage) {
  MatchResult& result = context.result;
  stage.input = result.stage(StageId::tf)->output;
  result.gms = gms_.filter(context.reference, context.target, result.correspondences);
  if (hasTwoView(options) && !options.gms.enabled && !options.growth.enabled) {
    result.gms.low_support =
        neighbours_.drop(context.reference, context.target, result.correspondences);
    result.gms.kept -= result.gms.low_support;
  }
  stage.output = result.gms.kept;
  return true;
}

/// Estimates the two-view geometry. This geometry becomes the result if the scene has depth, or if
/// no homography is wanted.
bool Chain::runTwoView(Context& context, StageResult& stage) {
  const MatchHints& hints = context.hints;
  MatchResult& result = context.result;
  TwoViewInput input;
  input.reference_camera = hints.reference_camera;
  input.target_camera = hints.target_camera;
  input.reference_lens = hints.reference_lens;
  input.target_lens = hints.target_lens;
  input.prediction = hints.motion;
  TwoViewMatches& found = result.two_view;
  two_view_.estimate(context.reference, context.target, result.correspondences, input, found);
  stage.input = result.gms.kept;
  stage.output = found.view.inliers;

  const bool epipolar = found.view.geometry == Geometry::epipolar;
  context.wants_homography = options.geometry == GeometryModel::automatic && !epipolar;
  if (context.wants_homography) return true;
  result.status = context.haveEnough() ? found.view.status : Status::too_few_features;
  if (!epipolar) return true;
  result.geometry = Geometry::epipolar;
  result.found_by = FoundBy::two_view;
  result.inliers = found.view.inliers;
  result.rmse = found.view.rmse;
  for (std::size_t i = 0; i < result.correspondences.size(); ++i) {
    result.correspondences[i].level = found.levels[i];
  }
  return true;
}

bool Chain::runProsac(Context& context, StageResult& stage) {
  MatchResult& result = context.result;
  stage.input = result.gms.kept;
  if (!context.wants_homography) return false;
  pairs_.clear();
  pairs_.rounding = util::kKeypointRounding;
  for (const Correspondence& c : result.correspondences) {
    if (c.level < Level::ktg) continue;
    pairs_.add(position(context.reference, c.reference_index),
               position(context.target, c.target_index), c.ratio());
  }
  std::optional<Eigen::Matrix3d> initial = context.hints.prediction;
  const TwoView& view = result.two_view.view;
  if (view.geometry != Geometry::none) initial = view.homography;
  prosac_.estimate(pairs_, context.reference.image_size, initial, result.prosac);

  const bool found = result.prosac.status == Status::ok;
  stage.output = found ? result.prosac.inliers : 0;
  result.status = context.haveEnough() ? result.prosac.status : Status::too_few_features;
  if (result.status != Status::ok) return true;
  result.found_by = FoundBy::prosac;
  if (options.growth.enabled) context.doubt = doubtful(context);
  if (!context.doubt) setAnswer(result.prosac, context);
  return true;
}

/// Returns PROSAC's homography if it is doubtful, otherwise an empty value. It is doubtful if few
/// matches agree with it, since a repetitive structure, such as the windows of a house, may have
/// misled PROSAC. If there is no prediction, it is also doubtful if the matches show that the
/// structure repeats (see ShiftVotes), or if it contradicts the details that exist once.
std::optional<GrowthStart> Chain::doubtful(const Context& context) {
  // With 30, 6 of 677 found warps were 20 px off, with 50 4 of 667 (doc/measurements/growth.md).
  constexpr std::size_t kFew = 50;
  // A homography with few inliers is doubtful if they are less than 1 / kOneIn of the matches.
  constexpr std::size_t kOneIn = 8;
  const MatchResult& result = context.result;
  const std::size_t inliers = result.prosac.inliers;
  if (inliers >= kFew || kOneIn * inliers >= pairs_.size()) {
    if (context.hints.prediction) return std::nullopt;
    shifts_.count(result.prosac.answer.homography, pairs_, context.target.image_size);
    if (!shifts_.isRivalled() && agreesWithDetails(context)) return std::nullopt;
  }
  GrowthStart start;
  start.homography = result.prosac.answer.homography;
  for (std::size_t i = 0; i < pairs_.size(); ++i) {
    if (result.prosac.mask[i] != 0) start.centre += pairs_.reference[i];
  }
  start.centre /= static_cast<double>(inliers);
  return start;
}

/// Returns false if the scene repeats itself and PROSAC's homography contradicts the details that
/// exist once (see SingleDetails). It is not tested if more than a quarter of the matches agree
/// with it: on drawn pages, a shift by a period had at most 14 % of them.
bool Chain::agreesWithDetails(const Context& context) {
  constexpr double kOneIn = 4.0;
  const growth::ShiftVotes::Peak& own = shifts_.own();
  if (!shifts_.isRepetitive() || kOneIn * own.votes > own.seen) return true;
  details_.setFrames(context.reference, context.target);
  const auto found = details_.count(context.result.prosac.answer.homography);
  return !found || !found->contradict();
}

/// If PROSAC found no homography or a doubtful one, grows homographies, provided that the whole
/// image was searched. A doubtful homography competes with the grown homographies (see
/// HomographyGrowth::Impl::choose); if the whole image was not searched, it is rejected.
bool Chain::runGrowth(Context& context, StageResult& stage) {
  MatchResult& result = context.result;
  if (!context.wants_homography || (result.status == Status::ok && !context.doubt)) return false;
  if (context.doubt) reject(result);
  // Growth needs the matches of the whole image: see MatchHints::prediction.
  if (result.search != Search::whole) return false;
  stage.input = static_cast<std::size_t>(
      std::count_if(result.correspondences.begin(), result.correspondences.end(),
                    [](const Correspondence& c) { return c.mutual; }));
  growth_.find(context.reference, context.hints.views, context.target, result.correspondences,
               context.doubt, result.growth);
  stage.output = result.growth.pairs.size();
  if (!result.growth.found) return true;
  result.status = Status::ok;
  result.found_by = FoundBy::growth;
  guided_matches_ = result.growth.matches;
  if (!adopt(result.growth.answer, context)) reject(result);
  return true;
}

bool Chain::runGuided(Context& context, StageResult& stage) {
  MatchResult& result = context.result;
  if (result.homographyStatus() != Status::ok) return false;
  stage.input = result.inliers;
  UncertainHomography candidate = result.answer;
  guided_.refine(context.reference, context.target, options.prosac.max_error,
                 options.growth.enabled, candidate, guided_matches_);
  adopt(candidate, context);
  stage.output = result.inliers;
  return true;
}

bool Chain::runAlignment(Context& context, StageResult& stage) {
  MatchResult& result = context.result;
  if (result.homographyStatus() != Status::ok) return false;
  result.surviving(Level::ktgp, matches_);
  matches_.insert(matches_.end(), result.guided.begin(), result.guided.end());
  AlignmentResult& aligned = result.alignment;
  alignment_.align(context.reference, context.target, matches_, result.answer, aligned);
  stage.input = matches_.size();
  stage.output = aligned.points.size();
  if (aligned.status == AlignmentStatus::ok && !adopt(aligned.answer, context)) {
    aligned.status = AlignmentStatus::not_better;
    aligned.answer = result.answer;
  }
  return true;
}

/// Makes `candidate` the answer, and derives the mask, the inliers and the RMSE from it. Returns
/// false, without any change, if the verdict rejects it.
///
/// Growth also works if very few of the matches are right, but then the verdict on all matches
/// would reject the homography. So the verdict on a grown homography uses the pairs of the growth,
/// even after the homography was refined.
bool Chain::adopt(const UncertainHomography& candidate, Context& context) {
  const MatchResult& result = context.result;
  const bool grown = result.found_by == FoundBy::growth;
  const double max_error = options.prosac.max_error;
  if (!verdict_.trusts(candidate, grown ? result.growth.pairs : pairs_,
                       context.reference.image_size, grown ? growth::Verdict::kRadius : max_error,
                       labelled_)) {
    return false;
  }
  if (grown) homography::label(candidate, pairs_, max_error, labelled_);
  setAnswer(labelled_, context);
  return true;
}

/// Sets the answer and the values that follow from it: the levels of the matches, the guided
/// matches that agree with it, the inliers and the RMSE. `found`: the answer with its labels for
/// the pairs that passed GMS.
void Chain::setAnswer(const ProsacResult& found, Context& context) {
  const Features& reference = context.reference;
  const Features& target = context.target;
  MatchResult& result = context.result;
  result.answer = found.answer;
  taken_.assign(target.size(), 0);
  std::size_t i = 0;
  for (Correspondence& c : result.correspondences) {
    if (c.level < Level::ktg) continue;
    const bool inlier = found.mask[i++] != 0;
    c.level = inlier ? Level::ktgp : Level::ktg;
    if (inlier) taken_[static_cast<std::size_t>(c.target_index)] = 1;
  }
  const double rmse = found.rmse;
  double squares = rmse * rmse * static_cast<double>(found.inliers);
  result.guided.clear();
  for (const Correspondence& c : guided_matches_) {
    if (taken_[static_cast<std::size_t>(c.target_index)] != 0) continue;
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

}  // namespace

void MatchResult::surviving(Level level, std::vector<Correspondence>& out) const {
  out.clear();
  for (const Correspondence& c : correspondences) {
    if (c.level >= level) out.push_back(c);
  }
}

const char* toString(FoundBy found_by) {
  return util::nameOf<FoundBy::two_view>(found_by, {"none", "prosac", "growth", "two_view"});
}

const char* toString(StageId stage) {
  return util::nameOf<StageId::two_view>(
      stage, {"knn", "tf", "gms", "prosac", "growth", "guided", "align", "two_view"});
}

const StageResult* MatchResult::stage(StageId id) const {
  for (const StageResult& one : stages) {
    if (one.id == id) return &one;
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
  Chain::nameStages(options, *this);
  clearGeometry(*this);
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
  options.shared_errors = SharedErrors::ofRealCameras();
  return options;
}

struct KtgpMatcher::Impl : Chain {
  using Chain::Chain;
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
  if (hints.prediction && !hints.prediction->allFinite()) {
    throw std::invalid_argument("the prediction is not finite; expected a homography");
  }
  result.descriptor = target.descriptor;
  impl_->run(reference, target, hints, result);
}

}  // namespace ktgp_orb
