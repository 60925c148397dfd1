#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <vector>

#include "ktgp_orb/correspondence.h"
#include "ktgp_orb/features.h"
#include "ktgp_orb/orb_extractor.h"
#include "ktgp_orb/prosac_homography.h"

namespace ktgp_orb {

/// Options of the search that grows a homography from single matches.
struct GrowthOptions {
  bool enabled = false;  ///< not in the paper
  int seeds = 30;        ///< matches that it is grown from at most, 1..10000: the bound on the work
  /// Views of a fixed reference that are searched, the image itself included, 0..13: from 5 on it
  /// is also seen at a tilt of 2 in four directions, from 13 on at a tilt of 4 in eight.
  /// SequenceMatcher makes them; HomographyGrowth takes those that it is given.
  int views = 0;
};

/// The reference as it looks from another side (Morel & Yu, ASIFT, SIAM J. Imaging Sci. 2009).
struct ReferenceView {
  Features features;                    ///< in px of the view
  Eigen::Matrix<double, 2, 3> to_view;  /// px of the reference image to px of the view
};

/// Made once for a reference that many images are matched to.
using ReferenceViews = std::vector<ReferenceView>;

/// The simulated views (GrowthOptions::views) without the image itself: 0, 4 or 12. `image`: 8-bit
/// grey. The features of a view are fewer in proportion to its size.
ReferenceViews simulateViews(const cv::Mat& image, const OrbOptions& options, int views);

/// What came of the search. Reused from call to call for its buffers.
struct GrowthResult {
  bool found = false;
  /// x_target ~ H x_reference in px, H(2,2) = 1; zero unless found.
  Eigen::Matrix3d homography = Eigen::Matrix3d::Zero();
  Covariance8 covariance = Covariance8::Zero();         ///< see UncertainHomography
  Covariance8 shared_covariance = Covariance8::Zero();  ///< the same
  double plane_deviation = 0.0;                         ///< px, the same
  /// What it rests on, each the other's nearest within 4 px; empty unless found.
  PointPairs pairs;
  /// Those of them that are keypoints of the reference itself and not of a simulated view, in
  /// target order, of Level::guided: they were found where a homography says.
  std::vector<Correspondence> matches;
  std::size_t support = 0;        ///< of the last one judged: pairs, one in 6x6 px
  double by_chance = 0.0;         ///< how many of them the decoys say that chance gives
  double log_false_alarms = 0.0;  ///< log10 of the expected number of false alarms
  int seeds = 0;                  ///< that were tried
  int judged = 0;                 ///< of them, that grew far enough to be judged

  /// As where nothing was tried; keeps the buffers.
  void clear();
};

/// Finds a homography that few matches agree with. PROSAC draws four of all matches; where one in a
/// hundred is right it cannot find four right ones. But a keypoint has a direction and a size, so
/// that one match alone says what is near it:
/// 1. Votes: matches that turn, scale and lie as a match says vote for it.
/// 2. Seeds: the matches with most votes, best first.
/// 3. Growth: an affine map from the seed and its voters, guided matching around it, the map fitted
///    anew, the region larger, ten times; a homography as soon as there are twelve matches.
/// 4. Verdict: the same homography shifted by 20 and 45 px in 24 directions each shows how many
///    matches chance gives with these images, descriptors and region. The a-contrario bound counts
///    the seeds and the maps that could have been fitted (see src/core/growth/verdict.h). The
///    homography must also show the whole reference as a plane from one side.
///
/// An instance belongs to one thread at a time; several instances may run side by side.
class HomographyGrowth {
 public:
  /// Throws std::invalid_argument naming the option and its range.
  explicit HomographyGrowth(const GrowthOptions& options = {});
  ~HomographyGrowth();
  HomographyGrowth(HomographyGrowth&&) noexcept;
  HomographyGrowth& operator=(HomographyGrowth&&) noexcept;

  const GrowthOptions& options() const;

  /// `matches`: of the two, those that are mutual count (KnnMatcher::matchMutual). `views`: of
  /// the reference, or null.
  void find(const Features& reference, const ReferenceViews* views, const Features& target,
            const std::vector<Correspondence>& matches, GrowthResult& result);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace ktgp_orb
