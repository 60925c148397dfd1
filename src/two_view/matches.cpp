#include <Eigen/Core>
#include <algorithm>

#include "features/alignment/local_maps.h"
#include "features/alignment/patch_aligner.h"
#include "ktgp_orb/two_view.h"
#include "util/keypoint_position.h"

namespace ktgp_orb {
namespace {

constexpr double kReach = 4.0;  // largest shift of a point by alignment, px
/// Standard deviation that is assumed for a keypoint's position, relative to the deviation of an
/// aligned point. The measured ratio is 3.4: the distances from the true epipolar lines have a
/// scale of 0.85 px for keypoints and 0.25 px for aligned points (medians over 20 sets of real and
/// synthetic scenes). But some keypoints are near their epipolar line by chance and hold the fit
/// near its start. Of the values 1, 3.4, 6 and 12 (about 3.4²), 12 gave the most accurate motions
/// in twelve sets.
constexpr double kKeypointDeviation = 12.0;
constexpr double kLeastCorrelation = 0.8 * 0.8;  // squared

}  // namespace

struct TwoViewMatcher::Impl {
  explicit Impl(const TwoViewOptions& options)
      : aligner(alignment::bestAlignmentKernels()), estimator(options) {}

  void collect(const Features& reference, const Features& target,
               const std::vector<Correspondence>& matches, TwoViewMatches& result);
  void align(const Features& reference, const Features& target, TwoViewMatches& result);
  void rectify(const Lens* lens, std::vector<Eigen::Vector2d>& points);
  void dropUnplaced(TwoViewMatches& result);

  alignment::PatchAligner aligner;
  TwoViewEstimator estimator;
  std::vector<double> deviations;
  std::vector<cv::KeyPoint> moved;
  PointPairs keypoints;
  alignment::LocalMaps maps;
};

void TwoViewMatcher::Impl::collect(const Features& reference, const Features& target,
                                   const std::vector<Correspondence>& matches,
                                   TwoViewMatches& result) {
  keypoints.clear();
  result.match.clear();
  result.levels.clear();
  for (std::size_t i = 0; i < matches.size(); ++i) {
    const Correspondence& match = matches[i];
    result.levels.push_back(std::min(match.level, Level::ktg));
    if (match.level < Level::ktg) continue;
    util::requireKeypoint(reference, match.reference_index, "reference");
    util::requireKeypoint(target, match.target_index, "target");
    result.match.push_back(i);
    keypoints.add(util::position(reference, match.reference_index),
                  util::position(target, match.target_index), match.ratio());
  }
}

/// Aligns the pairs, and moves aligned pairs to the front of PROSAC's order, because they are more
/// accurate.
void TwoViewMatcher::Impl::align(const Features& reference, const Features& target,
                                 TwoViewMatches& result) {
  constexpr double kLater = 1.0;  // puts unaligned pairs last, because no ratio is above 1
  result.pairs = keypoints;
  result.aligned.assign(keypoints.size(), 0);
  deviations.assign(keypoints.size(), kKeypointDeviation);
  if (!estimator.options().alignment) return;
  if (!aligner.setImages(reference.images, target.images)) return;
  maps.load(keypoints.reference, keypoints.target, reference.image_size);
  for (std::size_t i = 0; i < keypoints.size(); ++i) {
    const alignment::AlignedPatch patch = aligner.align(maps.at(i), keypoints.reference[i], kReach);
    if (patch.outcome != alignment::PatchOutcome::aligned ||
        patch.correlation < kLeastCorrelation) {
      result.pairs.quality[i] += kLater;
      continue;
    }
    result.pairs.reference[i] = patch.reference;
    result.pairs.target[i] = patch.target;
    result.aligned[i] = 1;
    deviations[i] = 1.0;
  }
}

/// Replaces points of an image by their positions without distortion.
void TwoViewMatcher::Impl::rectify(const Lens* lens, std::vector<Eigen::Vector2d>& points) {
  if (lens == nullptr) return;
  moved.clear();
  for (const Eigen::Vector2d& p : points) {
    moved.emplace_back(static_cast<float>(p.x()), static_cast<float>(p.y()), 1.F);
  }
  lens->rectify(moved);
  for (std::size_t i = 0; i < points.size(); ++i) points[i] = {moved[i].pt.x, moved[i].pt.y};
}

/// Removes a pair if the lens has no undistorted position for one of its points.
void TwoViewMatcher::Impl::dropUnplaced(TwoViewMatches& result) {
  std::size_t kept = 0;
  PointPairs& pairs = result.pairs;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (!pairs.reference[i].allFinite() || !pairs.target[i].allFinite()) continue;
    pairs.reference[kept] = pairs.reference[i];
    pairs.target[kept] = pairs.target[i];
    pairs.quality[kept] = pairs.quality[i];
    deviations[kept] = deviations[i];
    result.aligned[kept] = result.aligned[i];
    result.match[kept++] = result.match[i];
  }
  pairs.reference.resize(kept);
  pairs.target.resize(kept);
  pairs.quality.resize(kept);
  deviations.resize(kept);
  result.aligned.resize(kept);
  result.match.resize(kept);
}

TwoViewMatcher::TwoViewMatcher(const TwoViewOptions& options)
    : impl_(std::make_unique<Impl>(options)) {}

TwoViewMatcher::~TwoViewMatcher() = default;
TwoViewMatcher::TwoViewMatcher(TwoViewMatcher&&) noexcept = default;
TwoViewMatcher& TwoViewMatcher::operator=(TwoViewMatcher&&) noexcept = default;

void TwoViewMatcher::estimate(const Features& reference, const Features& target,
                              const std::vector<Correspondence>& matches, const TwoViewInput& input,
                              TwoViewMatches& result) {
  TwoViewInput sized = input;
  sized.reference_size = reference.image_size;
  sized.target_size = target.image_size;
  impl_->collect(reference, target, matches, result);
  impl_->align(reference, target, result);
  impl_->rectify(input.reference_lens, result.pairs.reference);
  impl_->rectify(input.target_lens, result.pairs.target);
  if (input.reference_lens != nullptr || input.target_lens != nullptr) impl_->dropUnplaced(result);
  sized.deviations = &impl_->deviations;
  impl_->estimator.estimate(result.pairs, sized, result.view);
  for (std::size_t i = 0; i < result.match.size(); ++i) {
    if (result.view.mask[i] != 0) result.levels[result.match[i]] = Level::ktgp;
  }
}

}  // namespace ktgp_orb
