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

/// Which kinds of geometry may explain the matches of level ktg.
enum class GeometryModel : std::uint8_t {
  homography = 0,  ///< only PROSAC's homography, as in the paper
  automatic = 1,   ///< homography or epipolar geometry, whichever is less likely to arise by chance
  epipolar = 2,    ///< only an epipolar geometry
};

/// Options of the four stages and of the stages that may follow.
struct MatcherOptions {
  KnnOptions knn;
  /// Threshold T_w of the ratio filter, in (0, 1]. If empty, the default for the kind of
  /// descriptors is used (see ratioThreshold).
  std::optional<double> ratio_threshold;
  /// If true, the ratio filter (TF) also requires that the two features are each other's nearest
  /// neighbours; not in the paper.
  bool mutual = false;
  /// gms.threshold is the paper's T_G. If GMS and growth are off and `geometry` is not
  /// `homography`, a match must be confirmed by two matches near it, and GmsResult::low_support
  /// counts the others.
  GmsOptions gms;
  ProsacOptions prosac;
  GrowthOptions growth;
  GuidedOptions guided;
  AlignmentOptions alignment;
  GeometryModel geometry = GeometryModel::homography;
  SharedErrors shared_errors;  ///< errors that the two-view geometry allows for

  /// The paper's four stages, followed by sub-pixel alignment. These are the defaults.
  static MatcherOptions ktgp() { return {}; }
  /// For hard pairs and for the best accuracy: mutual nearest neighbours without ratio test and
  /// GMS, then PROSAC, growth if PROSAC fails, a guided round and alignment.
  static MatcherOptions robust();
  /// For a moving camera in a scene with depth: mutual nearest neighbours without ratio test and
  /// GMS, if two near matches confirm them. The matches are aligned one by one, and the geometry
  /// that fits them best is estimated. Use it with KeypointDistribution::uniform.
  static MatcherOptions slam();
};

/// The stages, in the order in which MatchResult::stages lists them.
enum class StageId : std::uint8_t { knn, tf, gms, prosac, growth, guided, align, two_view };

/// Returns the enumerator's name, e.g. "two_view".
const char* toString(StageId stage);

/// Counts and time of one stage, as in the message StageStatistics. Of the paper's four stages, the
/// output of a stage is the input of the next one.
struct StageResult {
  StageId id = StageId::knn;
  /// For knn: number of target features. For the other stages: number of correspondences.
  std::size_t input = 0;
  /// Number of correspondences after the stage. For guided, this includes the added matches. For
  /// growth, it is the number of pairs that the homography was fitted to; for align, the number of
  /// aligned matches; for two_view, the number of matches that agree with the geometry.
  std::size_t output = 0;
  double milliseconds = 0.0;  ///< wall-clock time
};

/// Where the matches were searched for.
enum class Search : std::uint8_t {
  whole = 0,  ///< in the whole image
  near = 1,   ///< within the search radius of the predicted positions
  /// First near the predicted positions, without success, and then in the whole image.
  fell_back = 2,
};

/// Which stage found the geometry.
enum class FoundBy : std::uint8_t {
  none = 0,    ///< there is no geometry
  prosac = 1,  ///< PROSAC, from the matches of level ktg
  /// HomographyGrowth, from single matches, after PROSAC had found no homography that can be
  /// trusted.
  growth = 2,
  two_view = 3,  ///< the two-view geometry (TwoViewMatcher)
};

/// Returns the enumerator's name, e.g. "prosac".
const char* toString(FoundBy found_by);

/// Prior knowledge about two frames.
struct MatchHints {
  /// A predicted homography, reference to target, px. PROSAC scores it before its first sample (see
  /// ProsacHomography::estimate). With a search radius, KNN searches only near the predicted
  /// positions, and growth does not run. If growth is on, a homography with few inliers is then
  /// rejected, because only growth could judge it. In this case, match again with `whole_image`, as
  /// SequenceMatcher does.
  std::optional<Eigen::Matrix3d> prediction;
  /// If true, the whole image is searched, even if there is a search radius and a prediction.
  bool whole_image = false;
  /// Simulated views of the reference, in which growth searches, too; null if there are none.
  const ReferenceViews* views = nullptr;
  /// Camera matrices K of the images without lens distortion, px, for the two-view geometry. Leave
  /// the reference's K empty if it is not known; then no motion is estimated. If the target's K is
  /// empty, the reference's K is used, too; both images must then have the same size.
  std::optional<Eigen::Matrix3d> reference_camera;
  std::optional<Eigen::Matrix3d> target_camera;
  /// The lenses if the images are raw (not rectified), else null; see TwoViewInput.
  const Lens* reference_lens = nullptr;
  const Lens* target_lens = nullptr;
  /// A guess at the camera's motion, such as the motion of the previous frame; see TwoViewInput.
  std::optional<RelativePose> motion;
};

/// The result for one pair of frames. If you reuse it for the next call, it keeps its buffers.
struct MatchResult {
  /// Status::ok means that a geometry was found, of a kind that MatcherOptions::geometry allows.
  Status status = Status::no_reference;
  /// Status of the homography alone: model_rejected if the geometry is epipolar, else `status`.
  Status homographyStatus() const {
    return geometry == Geometry::epipolar ? Status::model_rejected : status;
  }
  DescriptorKind descriptor = DescriptorKind::orb;  ///< kind of the frames' descriptors
  /// Where matches were searched for; KtgpMatcher never sets fell_back.
  Search search = Search::whole;
  FoundBy found_by = FoundBy::none;
  /// One correspondence per target feature, in target order, with the level that it reached.
  std::vector<Correspondence> correspondences;
  GmsResult gms;
  /// Result of PROSAC alone; its mask has one entry per correspondence of level ktg and above.
  ProsacResult prosac;
  /// Results of the stages: always knn, tf, gms and prosac, then growth, guided, align and two_view
  /// if they are on.
  std::vector<StageResult> stages{{StageId::knn}, {StageId::tf}, {StageId::gms}, {StageId::prosac}};
  /// Returns the result of a stage; null if the stage is off.
  const StageResult* stage(StageId id) const;
  GrowthResult growth;  ///< result of growth; `seeds` is 0 if growth was not needed
  /// Matches that guided matching or growth added, in target order; all have Level::guided.
  std::vector<Correspondence> guided;
  AlignmentResult alignment;

  /// The geometry that explains the matches. If it is a plane or a rotation, `answer` has the
  /// homography. If it is epipolar, no homography explains all matches, and `answer` is zero;
  /// `two_view` then has the geometry, and the levels, `inliers` and `rmse` (of Sampson distances)
  /// refer to it.
  Geometry geometry = Geometry::none;
  TwoViewMatches two_view;  ///< two-view geometry; empty if MatcherOptions::geometry is homography

  /// The homography of PROSAC or of growth, refined by guided matching and alignment; zero unless
  /// homographyStatus() is ok. Levels, `guided`, `inliers` and `rmse` refer to this homography: a
  /// correspondence that passed GMS has Level::ktgp exactly when its reprojection error is below
  /// ProsacOptions::max_error. The result of PROSAC itself is in `prosac` and `stages`.
  UncertainHomography answer;
  /// Number of correspondences of level ktgp and above, including guided matches.
  std::size_t inliers = 0;
  double rmse = 0.0;  ///< root mean square reprojection error of the inliers, px
  /// Number of matches that passed the ratio filter and have the same position in both images,
  /// although `answer` says that the scene moves by 3 px or more. Such matches come from hot
  /// pixels, dirt on the lens, or text that is drawn into the images. If they would determine the
  /// answer or bend it, and the moving matches agree on one motion and are spread like them or are
  /// a clear majority, the moving matches alone determine the answer, and those that stand still
  /// get Level::kt.
  std::size_t still = 0;
  /// Returns true if more matches stand still than chance can explain.
  bool hasStillThings() const { return still >= 10 && 20 * still >= inliers; }

  /// Copies the correspondences that reached at least `level` into `out`, in target order.
  void surviving(Level level, std::vector<Correspondence>& out) const;
  /// Total time of all stages.
  double milliseconds() const;
  /// Resets this object to the result of a frame without a reference. `stages` then lists the
  /// stages that are on in `options`. Keeps the buffers.
  void clear(const MatcherOptions& options);
};

static_assert(alignof(MatchResult) <= alignof(std::max_align_t),
              "the layout of results must not depend on the instruction set of the includer");

/// Runs KNN -> TF -> GMS -> PROSAC on the features of two frames. Three more stages may be enabled:
/// growth, which runs if PROSAC finds no homography, then guided matching and sub-pixel alignment.
/// They do not change the counts of the four stages. If MatcherOptions::geometry asks for it, the
/// two-view geometry is estimated after GMS. If it is epipolar, PROSAC and the stages after it do
/// not run. An instance belongs to one thread at a time; several instances may work in parallel.
class KtgpMatcher {
 public:
  /// Throws std::invalid_argument, naming the option and its range, if an option is out of range.
  explicit KtgpMatcher(const MatcherOptions& options = {});
  ~KtgpMatcher();
  KtgpMatcher(KtgpMatcher&&) noexcept;
  KtgpMatcher& operator=(KtgpMatcher&&) noexcept;

  const MatcherOptions& options() const;

  /// Throws std::invalid_argument for malformed features (see requireValid), and if the two frames
  /// have different kinds of descriptors. Bad data, such as keypoints outside the image or no
  /// features at all, does not throw; the status says what happened.
  void match(const Features& reference, const Features& target, MatchResult& result);

  /// Matches as above, but uses prior knowledge. Also throws std::invalid_argument for a prediction
  /// that is not finite or, with a search radius, cannot be inverted, and for a matrix K that no
  /// camera can have (see TwoViewEstimator::estimate).
  void match(const Features& reference, const Features& target, const MatchHints& hints,
             MatchResult& result);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ktgp_orb
