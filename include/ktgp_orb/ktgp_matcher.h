#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "ktgp_orb/alignment.h"
#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/features.h"
#include "ktgp_orb/gms_filter.h"
#include "ktgp_orb/growth.h"
#include "ktgp_orb/guided_matcher.h"
#include "ktgp_orb/knn_matcher.h"
#include "ktgp_orb/prosac_homography.h"
#include "ktgp_orb/ratio_filter.h"
#include "ktgp_orb/status.h"
#include "ktgp_orb/two_view.h"

namespace ktgp_orb {

/// Which geometry explains the matches of level ktg.
enum class GeometryModel : std::uint8_t {
  homography = 0,  ///< the paper's chain: PROSAC's homography
  automatic = 1,   ///< homography or epipolar geometry, whichever chance explains less
  epipolar = 2,    ///< epipolar geometry alone
};

/// Options of the four stages and of the stages that may follow.
struct MatcherOptions {
  KnnOptions knn;
  /// T_w, in (0, 1]; empty: the default for the features' descriptors (see ratioThreshold).
  std::optional<double> ratio_threshold;
  /// Whether TF also requires that both are nearest to each other; not in the paper.
  bool mutual = false;
  GmsOptions gms;  ///< gms.threshold is T_G
  ProsacOptions prosac;
  GrowthOptions growth;
  GuidedOptions guided;
  AlignmentOptions alignment;
  GeometryModel geometry = GeometryModel::homography;
  double shared_error = 0.0;  ///< px, of the two-view geometry: see TwoViewOptions

  /// The paper's chain with alignment: the defaults.
  static MatcherOptions ktgp() { return {}; }
  /// For hard pairs and for best accuracy: mutual nearest neighbours without ratio test and GMS,
  /// PROSAC, a guided round, alignment.
  static MatcherOptions robust();
  /// For a moving camera in a scene with depth: mutual nearest neighbours without ratio test and
  /// GMS, the geometry that fits, from matches that are aligned one by one.
  static MatcherOptions slam();
};

/// The stages, in the order in which MatchResult::stages lists them.
enum class StageId : std::uint8_t { knn, tf, gms, prosac, growth, guided, align, two_view };

/// The enumerator's own name, e.g. "two_view".
const char* toString(StageId stage);

/// Counts and time of one stage (message: StageStatistics). The output of a stage is the input of
/// the next one.
struct StageResult {
  StageId id = StageId::knn;
  std::size_t input = 0;  ///< knn: target features; others: correspondences
  /// Correspondences left; guided: including those it added; growth: its own; align: aligned;
  /// two_view: those that agree with the geometry.
  std::size_t output = 0;
  double milliseconds = 0.0;  ///< wall-clock time
};

/// Where the matches were searched.
enum class Search : std::uint8_t {
  whole = 0,      ///< in the whole image
  near = 1,       ///< within the search radius of the predicted positions
  fell_back = 2,  ///< first near, without success; then in the whole image
};

/// Which stage found the geometry.
enum class FoundBy : std::uint8_t {
  none = 0,      ///< there is none
  prosac = 1,    ///< the matches of level ktg
  growth = 2,    ///< grown from single matches after PROSAC had found none (HomographyGrowth)
  two_view = 3,  ///< the two-view geometry (TwoViewMatcher)
};

/// The enumerator's own name, e.g. "prosac".
const char* toString(FoundBy found_by);

/// Prior knowledge about two frames.
struct MatchHints {
  /// A predicted homography, reference to target, px. PROSAC scores it before its first sample (see
  /// ProsacHomography::estimate). With a search radius, KNN searches only near its positions.
  /// Growth does not run then, and a homography that it would have to judge, since few matches
  /// agree with it, is rejected: match again with `whole_image`, as SequenceMatcher does.
  std::optional<Eigen::Matrix3d> prediction;
  /// Searches the whole image, even with a search radius and a prediction.
  bool whole_image = false;
  /// Simulated views of the reference for the growth, or null.
  const ReferenceViews* views = nullptr;
  /// K of images without distortion, px, for the two-view geometry; empty: not known, and there is
  /// no motion. The target's: empty if it is the reference's, whose image then has the same
  /// size.
  std::optional<Eigen::Matrix3d> reference_camera;
  std::optional<Eigen::Matrix3d> target_camera;
  /// The lens of raw images: see TwoViewInput.
  const Lens* reference_lens = nullptr;
  const Lens* target_lens = nullptr;
  /// A motion that may be right, as of the frame before; see TwoViewInput.
  std::optional<RelativePose> motion;
};

/// The result for one pair of frames. Reused from call to call for its buffers.
struct MatchResult {
  /// ok: `geometry` was found, and it is one that MatcherOptions::geometry asks for.
  Status status = Status::no_reference;
  /// The same for the homography alone: model_rejected where the geometry is epipolar.
  Status homographyStatus() const {
    return geometry == Geometry::epipolar ? Status::model_rejected : status;
  }
  DescriptorKind descriptor = DescriptorKind::orb;  ///< kind of the descriptors
  Search search = Search::whole;                    ///< KtgpMatcher never sets fell_back
  FoundBy found_by = FoundBy::none;
  /// One per target feature, in target order, with its level.
  std::vector<Correspondence> correspondences;
  GmsResult gms;
  ProsacResult prosac;  ///< its mask follows the correspondences of level ktg and above, in order
  /// knn, tf, gms, prosac: always these four. Then growth, guided, align, two_view: those that are
  /// on.
  std::vector<StageResult> stages{{StageId::knn}, {StageId::tf}, {StageId::gms}, {StageId::prosac}};
  /// Null: this stage is off.
  const StageResult* stage(StageId id) const;
  GrowthResult growth;  ///< has no seeds where growth was not needed
  /// Matches that guided matching or the growth added, in target order, all of Level::guided.
  std::vector<Correspondence> guided;
  AlignmentResult alignment;

  /// The geometry that explains the matches. Plane and rotation have `answer`, too. Epipolar: there
  /// is no homography for all (`answer` is zero), `two_view` has the geometry, and levels,
  /// `inliers` and `rmse` belong to it (rmse: of Sampson distances).
  Geometry geometry = Geometry::none;
  TwoViewMatches two_view;  ///< empty unless MatcherOptions::geometry asks for it

  /// PROSAC's homography or the grown one, refined by guided matching and alignment; zero unless
  /// homographyStatus() is ok. Levels, `guided`, `inliers` and `rmse` belong to this homography: a
  /// correspondence that passed GMS has Level::ktgp exactly when its reprojection error is below
  /// ProsacOptions::max_error. What PROSAC itself found is in `prosac` and `stages`.
  UncertainHomography answer;
  std::size_t inliers = 0;  ///< correspondences of level ktgp and above, guided ones included
  double rmse = 0.0;        ///< root mean square over them of the keypoints' reprojection error, px
  /// Matches of any level that stand still where `answer` says that the scene moves by 3 px or
  /// more: hot pixels, dirt on the lens, burned-in text. Where more matches stand still than move,
  /// and both are all over the image, those that move give the answer, and the others have level
  /// kt.
  std::size_t still = 0;
  /// Whether these are too many for chance.
  bool hasStillThings() const { return still >= 10 && 20 * still >= inliers; }

  /// Copies the correspondences that reached at least `level` into `out`, in target order.
  void surviving(Level level, std::vector<Correspondence>& out) const;
  /// Sum over all stages.
  double milliseconds() const;
  /// Becomes the result for a frame without a reference, with the stages that `options` enables;
  /// keeps the buffers.
  void clear(const MatcherOptions& options);
};

static_assert(alignof(MatchResult) <= alignof(std::max_align_t),
              "the layout of results must not depend on the instruction set of the includer");

/// KNN -> TF -> GMS -> PROSAC over the features of two frames. Then, where enabled: growth when
/// there is no homography, guided matching and sub-pixel alignment, which do not change the counts
/// of the four stages. With MatcherOptions::geometry the two-view geometry comes after GMS; where
/// it is epipolar, neither PROSAC's homography nor what follows it is looked for. An instance
/// belongs to one thread at a time; several instances may work in parallel.
class KtgpMatcher {
 public:
  /// Throws std::invalid_argument naming the option and its range.
  explicit KtgpMatcher(const MatcherOptions& options = {});
  ~KtgpMatcher();
  KtgpMatcher(KtgpMatcher&&) noexcept;
  KtgpMatcher& operator=(KtgpMatcher&&) noexcept;

  const MatcherOptions& options() const;

  /// Throws std::invalid_argument for malformed features (see requireValid) and for descriptors of
  /// two kinds. Bad data, such as keypoints outside the image or no features at all, is legal and
  /// gives a status.
  void match(const Features& reference, const Features& target, MatchResult& result);

  /// The same with prior knowledge. Throws std::invalid_argument for a prediction that is not
  /// finite or, with a search radius, cannot be inverted, and for a K that cannot be one (see
  /// TwoViewEstimator::estimate).
  void match(const Features& reference, const Features& target, const MatchHints& hints,
             MatchResult& result);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ktgp_orb
